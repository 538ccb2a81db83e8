"""Blocks that scenes of clutter are made of, with their grasps."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from split_drake.data.clutter.library import ClutterObject, GraspLibrary
from split_drake.data.clutter.scenes import ClutterRecipe
from split_drake.experiments.parts import parts_of
from split_drake.objects.task_object import ObjectSource, TaskObject
from split_drake.station.layout import Layout
from tests.split_drake.station.solids import solid_box, solid_cylinder

BODIES = {
    "bar": solid_box("bar", (0.04, 0.09, 0.05)),
    "can": solid_cylinder("can", 0.025, 0.1),
    "slab": solid_box("slab", (0.1, 0.12, 0.09)),
}


@dataclass(frozen=True)
class Blocks:
    """A bar, a can, and a slab that is too wide for the hand."""

    def names(self) -> tuple[str, ...]:
        return tuple(BODIES)

    def load(self, name: str) -> TaskObject:
        return TaskObject(body=BODIES[name])

    def sha256(self) -> str:
        return "blocks"


def write_library(source: ObjectSource, path: Path) -> None:
    with parts_of(path, {}) as parts:
        GraspLibrary.work_out(source, 1, parts).save(path)


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> GraspLibrary:
    path = tmp_path_factory.mktemp("library") / "blocks.npz"
    write_library(Blocks(), path)
    return GraspLibrary.load(path, Blocks())


@pytest.fixture(scope="session")
def bar(library: GraspLibrary) -> ClutterObject:
    return ClutterObject(Blocks().load("bar"), library.grasps["bar"])


@pytest.fixture(scope="session")
def can(library: GraspLibrary) -> ClutterObject:
    return ClutterObject(Blocks().load("can"), library.grasps["can"])


@pytest.fixture(scope="session")
def recipe(library: GraspLibrary, tmp_path_factory: pytest.TempPathFactory) -> ClutterRecipe:
    path: Path = tmp_path_factory.mktemp("library") / "blocks.npz"
    library.save(path)
    return ClutterRecipe(Blocks(), path, Layout())
