"""How many labelled scenes of clutter a core makes: ``pytest tests/benchmarks -k clutter_scenes``.

Scenes of up to six of the first training objects, view and labels included.
"""

import time
from dataclasses import dataclass, field
from functools import partial
from itertools import islice

import numpy as np
import pytest

from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScenes
from split_drake.objects.procedural.split import ProceduralSource
from split_drake.objects.task_object import TaskObject
from split_drake.station.layout import Layout
from tests.benchmarks.processor import processor
from tests.split_drake.data.clutter.conftest import write_library

OBJECTS, SCENES, REPEATS = 40, 40, 3


@dataclass(frozen=True)
class EachKind:
    """Some of the training objects, spread over all of them."""

    source: ProceduralSource = field(default_factory=partial(ProceduralSource, "train"))

    def names(self) -> tuple[str, ...]:
        every = self.source.names()
        return every[:: len(every) // OBJECTS]

    def load(self, name: str) -> TaskObject:
        return self.source.load(name)

    def sha256(self) -> str:
        return f"{OBJECTS} of {self.source.sha256()}"


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> ClutterRecipe:
    path = tmp_path_factory.mktemp("library") / "grasps.npz"
    write_library(EachKind(), path)
    return ClutterRecipe(EachKind(), path, Layout())


def test_clutter_scenes(recipe: ClutterRecipe, capsys: pytest.CaptureFixture[str]) -> None:
    scenes = ClutterScenes(recipe, np.random.default_rng(0)).draw_all()
    list(islice(scenes, SCENES))  # makes the objects
    rates = []
    for _ in range(REPEATS):
        clock_s = time.process_time()
        drawn = list(islice(scenes, SCENES))
        rates.append(SCENES / (time.process_time() - clock_s))
        assert all(len(scene.grasps.X_WGs) for scene in drawn)
    with capsys.disabled():
        print(
            f"\nscenes of clutter: {max(rates):.1f} a second of CPU (median "
            f"{np.median(rates):.1f}), one core, {processor()}"
        )
