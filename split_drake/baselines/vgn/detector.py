"""Grasps by VGN from the depth views of a scene."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from split_drake.baselines.selection import SelectionConfig, VolumeGrasps, chosen_grasps
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.scene import Scene, Workspace


class VgnDetector:
    """Grasps by VGN; it draws nothing.

    Attributes:
        threshold: the least quality that is accepted.

    Args:
        network: what it predicts with.
        selection: how grasps are chosen.
    """

    tasks = (GRASP,)

    def __init__(self, network: VgnNetwork, selection: SelectionConfig | None = None) -> None:
        self._network = network.eval()
        self._selection = selection or SelectionConfig()
        self.threshold = self._selection.least

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return grasps, where they are asked for; they are one voxel apart at least.

        Raises UnknownTaskError for any other task, ValueError where the scene has no views.
        """
        known = find_tasks(tasks, self.tasks, "VGN")
        field = fused_tsdf(scene.views, scene.workspace)
        return {task.name: self.grasps(field, scene.workspace) for task in known}

    @torch.inference_mode()
    def grasps(self, field: NDArray[np.float32], workspace: Workspace) -> PoseSet:
        """Return the grasps that a TSDF (40, 40, 40) of a workspace shows."""
        found = self._network(torch.tensor(field)[None])
        volume = VolumeGrasps(*(each[0].numpy() for each in found))
        return chosen_grasps(field, volume, workspace, self._selection)
