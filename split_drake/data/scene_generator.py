"""Labelled scenes of one mug, as the arrays of a shard."""

import numpy as np

from split_drake.data.dataset import DatasetError, Shard, encode_points
from split_drake.data.grasp_candidates import GraspCandidates, GraspState
from split_drake.data.mug_scenes import MugScene, MugScenes
from split_drake.scene import Workspace

MIN_GRASPS = 8
# A mug of which so many scenes in a row show too few grasps isn't one for this hand.
MAX_REDRAWS = 200


class SceneGenerator:
    """Draws scenes in which at least MIN_GRASPS candidates are true.

    Args:
        scenes: of the candidates' mug.
        candidates: its grasps.
        workspace: that the points are stored in.
        rng: what scenes are drawn from.

    Attributes:
        redraws: how many scenes so far were drawn again.
    """

    def __init__(
        self,
        scenes: MugScenes,
        candidates: GraspCandidates,
        workspace: Workspace,
        rng: np.random.Generator,
    ) -> None:
        self._scenes = scenes
        self._candidates = candidates
        self._workspace = workspace
        self._rng = rng
        self.redraws = 0

    def draw(self) -> tuple[MugScene, np.ndarray]:
        """Return a scene and the states (L,) of the candidates in it.

        Raises DatasetError where MAX_REDRAWS scenes in a row have too few true grasps.
        """
        for _ in range(MAX_REDRAWS):
            scene = self._scenes.draw(self._rng)
            states = self._candidates.states(scene)
            if (states == GraspState.TRUE).sum() >= MIN_GRASPS:
                return scene, states
            self.redraws += 1
        raise DatasetError(
            f"none of {MAX_REDRAWS} scenes of {self._candidates.mug.body.name} leaves {MIN_GRASPS} "
            f"of its {(self._candidates.weights > 0.0).sum()} grasps true"
        )

    def shard(self, count: int) -> Shard:
        """Return the arrays of `count` scenes, see `dataset`."""
        drawn = [self.draw() for _ in range(count)]
        scenes = [scene for scene, _ in drawn]
        candidates = self._candidates
        p_WSs = np.stack([scene.p_WSs for scene in scenes])
        return {
            "points": encode_points(p_WSs, self._workspace),
            "X_WOs": np.stack([scene.X_WO for scene in scenes]).astype(np.float32),
            "grasp_states": np.stack([states for _, states in drawn]),
            "handle_points": np.array([scene.handle_points for scene in scenes], np.int32),
            "views": np.array([scene.views for scene in scenes], np.uint8),
            "X_OGs": candidates.X_OGs.astype(np.float32),
            "qualities": candidates.weights.astype(np.float32),
            "X_OHs": candidates.mug.handle_poses(np.eye(4)).astype(np.float32),
            "redraws": np.array(self.redraws, np.int32),
        }
