"""Labelled scenes of clutter, drawn one after another: what lies there, and what is seen of it."""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from split_drake.bad_input import require_numbers
from split_drake.data.clutter.arrangements import Arrangement
from split_drake.data.clutter.drawing import Objects, arrangements
from split_drake.data.clutter.labels import SceneGrasps, label_scene
from split_drake.data.clutter.library import ClutterObject, GraspLibrary
from split_drake.data.clutter.views import ViewRandomization, see
from split_drake.data.dataset import DatasetError
from split_drake.experiments.provenance import file_sha256
from split_drake.objects.task_object import ObjectSource
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.scene import EmptySceneError, Scene
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_to_fields

LABEL_VERSION = 4
# A scene that shows less, or holds fewer true grasps, teaches little.
LEAST_POINTS, LEAST_TRUE, LEAST_FALSE = 150, 3, 1
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


@lru_cache(maxsize=1)
def _objects(source: KeptSource, library: Path) -> Objects:
    return Objects(source, GraspLibrary.load(library, source).grasps)


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

    def draw_all(self) -> Iterator[ClutterScene]:
        """Yield scenes without end: of packed objects, and of piles as they grow.

        Raises DatasetError where nothing useful comes of many arrangements.
        """
        empty = 0
        for objects, arrangement in arrangements(self._objects, self._recipe.layout, self._rng):
            scene = self._labelled(objects, arrangement)
            if scene is not None:
                empty = 0
                yield scene
                continue
            empty += 1
            if empty == MAX_EMPTY:
                raise DatasetError(f"{MAX_EMPTY} arrangements in a row show no grasp")

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
