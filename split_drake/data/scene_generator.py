"""Labelled scenes of one object, as the arrays of a shard."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from split_drake.data.dataset import DatasetError, Shard, encode_points
from split_drake.data.labels import PoseLabels, PoseState
from split_drake.data.object_scenes import ObjectScene, ObjectScenes
from split_drake.scene import Workspace

# An object of which so many scenes in a row show too few true poses isn't one for this hand.
MAX_REDRAWS = 200

States = dict[str, NDArray[np.uint8]]


class SceneGenerator:
    """Draws scenes in which enough poses of every task are true.

    Args:
        scenes: of one object.
        labels: {name of a task: its poses on that object}.
        workspace: that the points are stored in.
        rng: what scenes are drawn from.

    Attributes:
        redraws: how many scenes so far were drawn again.
    """

    def __init__(
        self,
        scenes: ObjectScenes,
        labels: Mapping[str, PoseLabels],
        workspace: Workspace,
        rng: np.random.Generator,
    ) -> None:
        self._scenes = scenes
        self._labels = labels
        self._workspace = workspace
        self._rng = rng
        self.redraws = 0

    def draw(self) -> tuple[ObjectScene, States]:
        """Return a scene and the states (L,) of each task's poses in it.

        Raises DatasetError where MAX_REDRAWS scenes in a row have too few true ones.
        """
        missing = ""
        for _ in range(MAX_REDRAWS):
            scene = self._scenes.draw(self._rng)
            states = {name: labels.states(scene) for name, labels in self._labels.items()}
            missing = self._missing(states)
            if not missing:
                return scene, states
            self.redraws += 1
        raise DatasetError(f"none of {MAX_REDRAWS} scenes of {self._scenes.name} {missing}")

    def _missing(self, states: States) -> str:
        """Return which task has too few true poses, or an empty string."""
        for name, labels in self._labels.items():
            if (states[name] == PoseState.TRUE).sum() < labels.least_true:
                known = int((labels.weights > 0.0).sum())
                return f"leaves {labels.least_true} of its {known} {name} poses true"
        return ""

    def shard(self, count: int) -> Shard:
        """Return the arrays of `count` scenes, see `dataset`."""
        drawn = [self.draw() for _ in range(count)]
        scenes = [scene for scene, _ in drawn]
        p_WSs = np.stack([scene.p_WSs for scene in scenes])
        shard: Shard = {
            "points": encode_points(p_WSs, self._workspace),
            "X_WOs": np.stack([scene.X_WO for scene in scenes]).astype(np.float32),
            "subjects": np.zeros(len(scenes), np.int32),
            "p_WCs": np.stack([scene.p_WC for scene in scenes]).astype(np.float32),
            "feature_points": np.array([scene.feature_points for scene in scenes], np.int32),
            "views": np.array([scene.views for scene in scenes], np.uint8),
            "redraws": np.array(self.redraws, np.int32),
        }
        for name, labels in self._labels.items():
            shard[f"{name}/X_OPs"] = labels.X_OPs[None].astype(np.float32)
            shard[f"{name}/weights"] = labels.weights[None].astype(np.float32)
            shard[f"{name}/states"] = np.stack([states[name] for _, states in drawn])
        return shard
