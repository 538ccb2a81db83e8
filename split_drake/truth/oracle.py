"""Ground truth: the simulator's state, and the true pose sets of a mug.

Nothing else reads the simulator's state; detectors and planners see depth images only.
"""

from collections.abc import Sequence

import numpy as np

from split_drake.grasps.judge import feasible
from split_drake.grasps.sampling import GraspLabels
from split_drake.objects.mug_shape import MugShape
from split_drake.pose_set import PoseSet
from split_drake.pose_task import PoseTask
from split_drake.poses import Array
from split_drake.scene import Scene
from split_drake.truth.state import Truth


class OracleDetector:
    """Returns the true pose sets of a mug, whatever the scene shows; a PoseDetector.

    Grasps come from the labels that are feasible as the mug lies, ranked by their quality; the
    handle's two symmetric poses and the upright pose have score 1.

    Args:
        truth: of the station.
        mug: the shape of object `index`.
        labels: of that mug.
        index: which object it is.
        max_grasps: a random subset of this many grasps is returned where there are more.
    """

    def __init__(
        self,
        truth: Truth,
        mug: MugShape,
        labels: GraspLabels,
        index: int = 0,
        max_grasps: int = 512,
    ) -> None:
        self._truth = truth
        self._mug = mug
        self._labels = labels
        self._index = index
        self._max_grasps = max_grasps

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, PoseSet]:
        """Return one pose set for each of `tasks`; the grasps' set is empty if none is feasible."""
        X_WO = self._truth.X_WO(self._index)
        return {task: self._pose_set(task, X_WO, rng) for task in tasks}

    def _pose_set(self, task: PoseTask, X_WO: Array, rng: np.random.Generator) -> PoseSet:
        if task is PoseTask.GRASP:
            return self._grasps(X_WO, rng)
        X_WPs = self._mug.handle_poses(X_WO) if task is PoseTask.HANDLE else X_WO[None]
        return PoseSet(task, X_WPs, np.ones(len(X_WPs)))

    def _grasps(self, X_WO: Array, rng: np.random.Generator) -> PoseSet:
        labels = self._labels
        kept = np.flatnonzero(feasible(X_WO, labels.X_OGs, labels.openings_m))
        if len(kept) > self._max_grasps:
            kept = rng.choice(kept, self._max_grasps, replace=False)
        return PoseSet.ranked(PoseTask.GRASP, X_WO @ labels.X_OGs[kept], labels.qualities[kept])
