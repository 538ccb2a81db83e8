"""The true pose sets of an object, by the simulator's state."""

from collections.abc import Sequence

import numpy as np

from split_drake.bad_input import require_count
from split_drake.grasps.judge import feasible
from split_drake.grasps.sampling import GraspLabels
from split_drake.objects.task_object import TaskObject
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.poses import Array
from split_drake.scene import Scene
from split_drake.truth.state import Truth


class OracleDetector:
    """Returns the true pose sets of an object, whatever the scene shows; a PoseDetector.

    Grasps come from the labels that are feasible as the object lies, ranked by their quality; the
    poses of its other tasks, those that mean the same after a half turn both, have score 1.

    Attributes:
        tasks: that it knows: grasps, and those of the object.

    Args:
        truth: of the station.
        subject: object `index`.
        labels: grasps of that object.
        index: which object it is.
        max_grasps: a random subset of this many grasps is returned where there are more.
    """

    def __init__(
        self,
        truth: Truth,
        subject: TaskObject,
        labels: GraspLabels,
        index: int = 0,
        max_grasps: int = 512,
    ) -> None:
        require_count("max_grasps", max_grasps, 1)
        self.tasks = (GRASP, *subject.X_OPs)
        self._truth = truth
        self._subject = subject
        self._labels = labels
        self._index = index
        self._max_grasps = max_grasps

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return a pose set for each of `tasks`; the grasps' set is empty if none is feasible.

        Raises UnknownTaskError naming the tasks of the object, for any other.
        """
        X_WO = self._truth.X_WO(self._index)
        known = find_tasks(tasks, self.tasks, self._subject.name)
        return {
            task.name: self._pose_set(task, X_WO, scene.workspace.p_WCenter[2], rng)
            for task in known
        }

    def _pose_set(
        self, task: PoseTask, X_WO: Array, table_z_m: float, rng: np.random.Generator
    ) -> PoseSet:
        if task == GRASP:
            return self._grasps(X_WO, table_z_m, rng)
        X_WPs = self._subject.true_poses(task, X_WO)
        return PoseSet(task, X_WPs, np.ones(len(X_WPs)))

    def _grasps(self, X_WO: Array, table_z_m: float, rng: np.random.Generator) -> PoseSet:
        labels = self._labels
        kept = np.flatnonzero(feasible(X_WO, labels.X_OGs, labels.openings_m, table_z_m))
        if len(kept) > self._max_grasps:
            kept = rng.choice(kept, self._max_grasps, replace=False)
        return PoseSet.ranked(GRASP, X_WO @ labels.X_OGs[kept], labels.qualities[kept])
