"""Detectors that find grasps in a TSDF of a scene's views."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from split_drake.baselines.selection import SelectionConfig, Volume, VolumeGrasps, chosen_grasps
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.scene import Scene, Workspace


class VolumeDetector(ABC):
    """Grasps by a network that says of each voxel how a palm there would grasp; it draws nothing.

    Attributes:
        tasks: grasps alone.
        name: of the method, for messages.

    Args:
        selection: how grasps are chosen.
    """

    tasks = (GRASP,)
    name: str

    def __init__(self, selection: SelectionConfig) -> None:
        self._selection = selection

    @abstractmethod
    def predict(self, field: Volume) -> VolumeGrasps:
        """Return a palm's pose and its quality for each voxel of a field (40, 40, 40)."""

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return grasps, where they are asked for; they are one voxel apart at least.

        Raises UnknownTaskError for any other task, ValueError where the scene has no views.
        """
        known = find_tasks(tasks, self.tasks, self.name)
        field = fused_tsdf(scene.views, scene.workspace)
        return {task.name: self.grasps(field, scene.workspace) for task in known}

    def grasps(self, field: Volume, workspace: Workspace) -> PoseSet:
        """Return the grasps that a TSDF (40, 40, 40) of a workspace shows."""
        return chosen_grasps(field, self.predict(field), workspace, self._selection)
