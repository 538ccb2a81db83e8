"""Labelled scenes of clutter, drawn one after another: what lies there, and what is seen of it."""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from split_drake.bad_input import require_numbers
from split_drake.data.clutter.arrangements import Arrangement, packed, subsets
from split_drake.data.clutter.labels import SceneGrasps, label_scene
from split_drake.data.clutter.library import ClutterObject, GraspLibrary
from split_drake.data.clutter.piles import PileSimulator
from split_drake.data.clutter.views import ViewRandomization, see
from split_drake.data.dataset import DatasetError
from split_drake.experiments.provenance import file_sha256
from split_drake.objects.task_object import ObjectSource
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.scene import EmptySceneError, Scene
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_to_fields

LABEL_VERSION = 4
PILE_SHARE = 0.5
# Objects in a scene at most.
MOST_OBJECTS = 6
# A scene that shows less, or holds fewer true grasps, teaches little.
LEAST_POINTS, LEAST_TRUE, LEAST_FALSE = 150, 3, 1
# Piles are simulated with a longer step than trials: nothing is held.
PILE_STEP_S = 0.004
MAX_EMPTY = 2000


class KeptSource(ObjectSource, Hashable, Protocol):
    """A source whose objects a process keeps once it has made them."""


@dataclass(frozen=True)
class ClutterRecipe:
    """What clutter scenes are made of; pickled by worker processes.

    Attributes:
        source: of the objects.
        library: file of their grasps.
        layout: of table and workspace; cameras are drawn.
        views: from where scenes are seen.
        seed: of all draws, together with the shard's number.
    """

    source: KeptSource
    library: Path
    layout: Layout
    views: ViewRandomization = field(default_factory=ViewRandomization)
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self)

    def config(self) -> dict[str, Any]:
        """Return all that the scenes depend on."""
        return {
            "objects": self.source.sha256(),
            "tasks": [asdict(GRASP)],
            "seed": self.seed,
            "views": asdict(self.views),
            "layout": layout_to_fields(self.layout),
            "library_sha256": file_sha256(self.library),
            "label_version": LABEL_VERSION,
        }

    def objects(self) -> "Objects":
        """Return the objects with their grasps, kept in this process."""
        return _objects(self.source, self.library)


class Objects:
    """Objects of a source, made when they are first wanted.

    Those without a grasp lie there as well: they have to be told from others.
    """

    def __init__(self, source: ObjectSource, library: GraspLibrary) -> None:
        self._source = source
        self._grasps = library.grasps
        self._names = list(library.grasps)
        self._made: dict[str, ClutterObject] = {}

    def draw(self, count: int, rng: np.random.Generator) -> list[ClutterObject]:
        """Return objects drawn with replacement."""
        return [self._get(self._names[n]) for n in rng.integers(len(self._names), size=count)]

    def _get(self, name: str) -> ClutterObject:
        if name not in self._made:
            self._made[name] = ClutterObject(self._source.load(name), self._grasps[name])
        return self._made[name]


@lru_cache(maxsize=1)
def _objects(source: KeptSource, library: Path) -> Objects:
    return Objects(source, GraspLibrary.load(library, source))


@dataclass(frozen=True)
class ClutterScene:
    """A labelled scene.

    Attributes:
        scene: what is seen.
        p_WC: (3,) where the camera stands.
        grasps: in it.
        objects: that are there, K.
        X_WOs: (K, 4, 4) how they lie.
    """

    scene: Scene
    p_WC: Array
    grasps: SceneGrasps
    objects: tuple[ClutterObject, ...]
    X_WOs: Array


class ClutterScenes:
    """Draws labelled scenes of clutter.

    Args:
        recipe: of the scenes.
        rng: what they are drawn from.
    """

    def __init__(self, recipe: ClutterRecipe, rng: np.random.Generator) -> None:
        self._recipe = recipe
        self._rng = rng
        self._objects = recipe.objects()
        layout = recipe.layout
        self._pile_config = StationConfig(layout, time_step_s=PILE_STEP_S)

    def draw_all(self) -> Iterator[ClutterScene]:
        """Yield scenes without end: of packed objects, and of piles as they grow.

        Raises DatasetError where nothing useful comes of many arrangements.
        """
        empty = 0
        for objects, arrangement in self._arrangements():
            scene = self._labelled(objects, arrangement)
            if scene is not None:
                empty = 0
                yield scene
                continue
            empty += 1
            if empty == MAX_EMPTY:
                raise DatasetError(f"{MAX_EMPTY} arrangements in a row show no grasp")

    def _arrangements(self) -> Iterator[tuple[list[ClutterObject], Arrangement]]:
        rng, workspace = self._rng, self._recipe.layout.workspace
        piled = standing = 0
        while True:
            objects = self._objects.draw(int(rng.integers(1, MOST_OBJECTS + 1)), rng)
            if piled < PILE_SHARE * (piled + standing + 1):
                for arrangement in self._pile(objects):
                    piled += 1
                    yield objects, arrangement
            else:
                whole = packed(objects, workspace, rng)
                # With fewer objects, too: rounds end with one.
                every = list(subsets(whole))
                for number in dict.fromkeys((len(every) - 1, int(rng.integers(len(every))))):
                    standing += 1
                    yield objects, every[number]

    def _pile(self, objects: Sequence[ClutterObject]) -> Iterator[Arrangement]:
        try:
            yield from PileSimulator(objects, self._pile_config).drop_all(self._rng)
        except RuntimeError:  # Drake's contact solver: what fell before is seen already
            return

    def _labelled(
        self, objects: Sequence[ClutterObject], arrangement: Arrangement
    ) -> ClutterScene | None:
        there = tuple(objects[number] for number in arrangement.numbers)
        workspace = self._recipe.layout.workspace
        try:
            scene, p_WC = see(there, arrangement.X_WOs, workspace, self._recipe.views, self._rng)
        except EmptySceneError:
            return None
        if len(scene.p_WPs) < LEAST_POINTS:
            return None
        table_z_m = self._recipe.layout.table_z_m
        grasps = label_scene(there, arrangement.X_WOs, scene.p_WPs, table_z_m, self._rng)
        grasps = _inside(grasps, scene)
        if len(grasps.X_WGs) < LEAST_TRUE or len(grasps.X_WFs) < LEAST_FALSE:
            return None
        return ClutterScene(scene, p_WC, grasps, there, arrangement.X_WOs)


def _inside(grasps: SceneGrasps, scene: Scene) -> SceneGrasps:
    """Return the grasps whose frames lie in the scene's cube."""

    def within(X_WGs: Array) -> np.ndarray:
        p_VGs = X_WGs[:, :3, 3] - scene.workspace.p_WV
        return np.all((p_VGs > 0.0) & (p_VGs < scene.workspace.edge_m), axis=1)

    kept = within(grasps.X_WGs)
    return replace(
        grasps,
        X_WGs=grasps.X_WGs[kept],
        weights=grasps.weights[kept],
        X_WFs=grasps.X_WFs[within(grasps.X_WFs)],
    )
