"""The true grasps of what is there: how far a method could come."""

from pathlib import Path

import numpy as np

from scenarios.clutter.clearing import Clearing
from scenarios.clutter.detection import ClutterDetector, ranked
from split_drake.data.clutter.labels import label_scene
from split_drake.data.clutter.library import ClutterObject, object_grasps
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import TaskObject
from split_drake.pose_set import PoseSet
from split_drake.scene import Scene


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
        grasps = label_scene(objects, X_WOs, scene.p_WPs, scene.workspace.p_WCenter[2], rng)
        return ranked(grasps.X_WGs, grasps.weights)

    def _object(self, index: int) -> ClutterObject:
        if index not in self._objects:
            body: RigidObject = self._clearing.objects[index]
            rng = np.random.default_rng([self._seed, index])
            self._objects[index] = ClutterObject(TaskObject(body=body), object_grasps(body, rng))
        return self._objects[index]


def make(checkpoint: Path | None, clearing: Clearing, rng: np.random.Generator) -> TrueGrasps:
    """Return what finds the true grasps of a round."""
    return TrueGrasps(clearing, rng)


DETECTOR = ClutterDetector("oracle", "", make)
