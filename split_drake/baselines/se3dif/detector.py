"""Grasps by SE(3)-DiffusionFields, of the whole cloud or of each segment of it."""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np
import torch

from split_drake.baselines.se3dif.clouds import drawn_points, scaled_cloud
from split_drake.baselines.se3dif.diffusion import Se3DifSampler
from split_drake.baselines.se3dif.network import CLOUD_POINTS, SCALE, Se3DifNetwork
from split_drake.objects_in_view import scenes_of_objects
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.poses import Array, make_pose
from split_drake.scene import Scene

_SEEDS = 2**63


class Se3DifDetector:
    """Grasps by SE(3)-DiffusionFields.

    The method has no evaluator.  The paper does not say how its grasps were ranked; they are ranked
    by their energy here, the least first, and a score is 1 / (1 + exp(energy)).

    Attributes:
        tasks: grasps alone.

    Args:
        network: whose energy is followed.
        segments: whether each segment is looked at alone, or the whole cloud at once.
        sampler: how poses are drawn; segments share the samples equally.
        in_bfloat16: whether the energy's products are computed in that type, which moves grasps by
            less than a millimetre: Langevin's own noise is a hundred times as large.
    """

    tasks = (GRASP,)

    def __init__(
        self,
        network: Se3DifNetwork,
        segments: bool,
        sampler: Se3DifSampler | None = None,
        in_bfloat16: bool = False,
    ) -> None:
        self._network = network.eval().requires_grad_(False)
        self._segments = segments
        self._sampler = sampler or Se3DifSampler()
        self._in_bfloat16 = in_bfloat16

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return all grasps that were drawn and lie in the workspace, where they are asked for.

        Raises UnknownTaskError for any other task.
        """
        known = find_tasks(tasks, self.tasks, "SE(3)-DiffusionFields")
        generator = torch.Generator().manual_seed(int(rng.integers(_SEEDS)))
        return {task.name: self._grasps(scene, generator) for task in known}

    def _grasps(self, scene: Scene, generator: torch.Generator) -> PoseSet:
        parts = scenes_of_objects(scene) if self._segments else [scene]
        sampler = replace(self._sampler, samples=ceil(self._sampler.samples / len(parts)))
        found = [self._grasps_of(part.p_WSs, sampler, generator) for part in parts]
        X_WGs = np.concatenate([each[0] for each in found])
        scores = np.concatenate([each[1] for each in found])
        p_VGs = X_WGs[:, :3, 3] - scene.workspace.p_WV
        inside = np.all((p_VGs > 0.0) & (p_VGs < scene.workspace.edge_m), axis=1)
        return PoseSet.ranked(GRASP, X_WGs[inside], scores[inside])

    def _grasps_of(
        self, p_WPs: Array, sampler: Se3DifSampler, generator: torch.Generator
    ) -> tuple[Array, Array]:
        """Return grasps (N, 4, 4) and scores (N,) of a cloud (P, 3)."""
        points = torch.tensor(p_WPs, dtype=torch.float32)
        cloud, middle = scaled_cloud(drawn_points(points, CLOUD_POINTS, generator))
        with torch.no_grad():
            self._network.in_bfloat16 = False
            code = self._network.encode(cloud[None])
            self._network.in_bfloat16 = self._in_bfloat16
            R, p, energy = sampler.draw(self._network, code, generator)
        p_WGs = p / SCALE + middle
        R_WGs = _orthonormal(R.double().numpy())
        return make_pose(R_WGs, p_WGs.double().numpy()), torch.sigmoid(-energy).double().numpy()


def _orthonormal(R: Array) -> Array:
    """Return the rotations nearest to matrices (N, 3, 3) that many products have made inexact."""
    left, _, right = np.linalg.svd(R)
    return np.asarray(left @ right)
