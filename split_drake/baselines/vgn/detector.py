"""Grasps by VGN from the depth views of a scene."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from split_drake.baselines.palm_frame import grippers_of_palms
from split_drake.baselines.tsdf import RESOLUTION, fused_tsdf
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.baselines.vgn.selection import masked_quality, peaks
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.poses import make_pose
from split_drake.scene import Scene, Workspace

# VGN takes grasps from there on, at random.
THRESHOLD = 0.90


class VgnDetector:
    """Grasps by VGN; it draws nothing.

    Attributes:
        threshold: the least quality that is accepted.
    """

    tasks = (GRASP,)

    def __init__(self, network: VgnNetwork, threshold: float = THRESHOLD) -> None:
        self._network = network.eval()
        self.threshold = threshold

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
        quality, width = (each[0].numpy() for each in (found.quality, found.width_voxels))
        masked = masked_quality(field, quality, width)
        voxels = peaks(masked, self.threshold)
        x, y, z = voxels.T
        R_VTs = Rotation.from_quat(found.quaternion_xyzw[0].numpy()[x, y, z]).as_matrix()
        p_WTs = voxels * (workspace.edge_m / RESOLUTION) + workspace.p_WV
        X_WTs = make_pose(R_VTs, p_WTs)
        return PoseSet.ranked(GRASP, grippers_of_palms(X_WTs), masked[x, y, z].astype(float))
