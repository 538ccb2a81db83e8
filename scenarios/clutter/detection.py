"""Where the grasps of clutter removal come from: SPLIT, or the true grasps of what is there."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from scenarios.clutter.clearing import Clearing
from split_drake.data.clutter.labels import label_scene
from split_drake.data.clutter.library import ClutterObject, object_grasps
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import TaskObject
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.scene import Scene

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector

DetectorName = Literal["split", "oracle"]


class TrueGrasps:
    """Grasps by what really lies there: those that labels of training scenes call true.

    They are scored by quality times squared steadiness, and seen by the cloud as labels are.
    """

    def __init__(self, clearing: Clearing, rng: np.random.Generator) -> None:
        self._clearing = clearing
        self._seed = int(rng.integers(2**63))
        self._objects: dict[int, ClutterObject] = {}

    def detect(self, scene: Scene, rng: np.random.Generator) -> PoseSet:
        """Return the feasible grasps of the objects that are left, best first."""
        there = self._clearing.left
        objects = [self._object(index) for index in there]
        X_WOs = np.array([self._clearing.truth.X_WO(index) for index in there]).reshape(-1, 4, 4)
        grasps = label_scene(objects, X_WOs, scene.p_WPs, rng)
        return ranked(grasps.X_WGs, grasps.weights)

    def _object(self, index: int) -> ClutterObject:
        if index not in self._objects:
            body: RigidObject = self._clearing.objects[index]
            rng = np.random.default_rng([self._seed, index])
            self._objects[index] = ClutterObject(TaskObject(body=body), object_grasps(body, rng))
        return self._objects[index]


class SplitGrasps:
    """Grasps by SPLIT."""

    def __init__(self, checkpoint: Path) -> None:
        self._detector = split_detector(checkpoint)

    def detect(self, scene: Scene, rng: np.random.Generator) -> PoseSet:
        """Return the accepted grasps, best first."""
        return self._detector.detect(scene, (GRASP,), rng)[GRASP.name]


@lru_cache(maxsize=1)
def split_detector(checkpoint: Path) -> "SplitDetector":
    """Return this process's SPLIT, on one thread."""
    from split_drake.split.detector import CLUTTER_SAMPLER, single_threaded_detector

    return single_threaded_detector(checkpoint, CLUTTER_SAMPLER)


def ranked(X_WGs: Array, scores: Sequence[float] | Array) -> PoseSet:
    """Return grasps (N, 4, 4) with scores (N,) as a pose set, best first."""
    order = np.argsort(-np.asarray(scores), kind="stable")
    return PoseSet(GRASP, np.asarray(X_WGs)[order], np.asarray(scores, dtype=float)[order])
