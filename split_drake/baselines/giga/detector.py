"""Grasps by GIGA from the depth views of a scene."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from split_drake.baselines.giga.network import RESOLUTION, GigaNetwork
from split_drake.baselines.selection import SelectionConfig, VolumeGrasps, chosen_grasps
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.scene import Scene, Workspace

# As in the runs that its public code has: the best grasp counts where none is very good.
SELECTION = SelectionConfig(
    threshold=0.90, fallback_threshold=0.5, free=0.1, border_m=0.02, lowest_m=0.055
)


class GigaDetector:
    """Grasps by GIGA; it draws nothing.

    Attributes:
        threshold: the least quality that is accepted.

    Args:
        network: what it predicts with, at the corner of every voxel.
        selection: how grasps are chosen.
    """

    tasks = (GRASP,)

    def __init__(self, network: GigaNetwork, selection: SelectionConfig = SELECTION) -> None:
        self._network = network.eval()
        self._selection = selection
        self._points = _corners()
        self.threshold = selection.least

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return grasps, where they are asked for; they are one voxel apart at least.

        Raises UnknownTaskError for any other task, ValueError where the scene has no views.
        """
        known = find_tasks(tasks, self.tasks, "GIGA")
        field = fused_tsdf(scene.views, scene.workspace)
        return {task.name: self.grasps(field, scene.workspace) for task in known}

    @torch.inference_mode()
    def grasps(self, field: NDArray[np.float32], workspace: Workspace) -> PoseSet:
        """Return the grasps that a TSDF (40, 40, 40) of a workspace shows."""
        found = self._network(torch.tensor(field)[None], self._points)
        quality, quaternion, width = (
            each[0].unflatten(0, (RESOLUTION,) * 3).numpy() for each in found
        )
        volume = VolumeGrasps(quality, quaternion, RESOLUTION * width)
        return chosen_grasps(field, volume, workspace, self._selection)


def _corners() -> torch.Tensor:
    """Return the voxels' lowest corners (1, r^3, 3) in the cube [-0.5, 0.5]^3."""
    line = torch.arange(RESOLUTION) / RESOLUTION - 0.5
    grid = torch.stack(torch.meshgrid(line, line, line, indexing="ij"), dim=-1)
    return grid.reshape(1, -1, 3)
