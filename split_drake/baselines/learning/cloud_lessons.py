"""Batches of clouds with true grasps, for SE(3)-DiffusionFields: of whole scenes, or of segments.

The method is made for one object; a segment is what is connected in the cloud, which touching
objects are together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from split_drake.baselines.se3dif.clouds import drawn_points, scaled_cloud
from split_drake.baselines.se3dif.network import CLOUD_POINTS, SCALE
from split_drake.data.dataset import SceneDataset
from split_drake.data.labels import PoseState
from split_drake.objects_in_view import objects_in_view, owners
from split_drake.pose_task import GRASP
from split_drake.poses import Array

Mask = NDArray[np.bool_]

# Standard deviations of the points' noise are drawn from this range, metres, as for SPLIT.
NOISE_M = (0.0, 0.008)
# More would cost more than they teach: a scene takes 1.2 s of a core with 24, 3.5 s with 96, both
# without bfloat16, which takes 0.36 of that time where the processor has it.
GRASPS = 24


class CloudBatch(NamedTuple):
    """Clouds and true grasps beside them, about each cloud's middle and scaled.

    Attributes:
        points: (B, CLOUD_POINTS, 3).
        R: (B, N, 3, 3).
        p: (B, N, 3).
    """

    points: Tensor
    R: Tensor
    p: Tensor


@dataclass(frozen=True)
class CloudScenes:
    """The clouds of a dataset of clutter, with their true grasps.

    Attributes:
        clouds: (S, P, 3) sampled points, metres in W.
        X_WGs: (S, L, 4, 4) grasps.
        weights: (S, L) how often to learn each; 0 for those that are not true.
    """

    clouds: Tensor
    X_WGs: Tensor
    weights: Tensor

    @classmethod
    def of(cls, dataset: SceneDataset) -> Self:
        """Return the scenes of a dataset of clutter, whose subjects are scenes."""
        labels = dataset.labels[GRASP.name]
        true = labels.states == PoseState.TRUE
        weights = np.where(true, labels.weights[dataset.object_index], 0.0)
        X_WGs = dataset.X_WOs[:, None] @ labels.X_OPs[dataset.object_index]
        return cls(
            torch.from_numpy(dataset.clouds),
            torch.from_numpy(X_WGs.astype(np.float32)),
            torch.from_numpy(weights.astype(np.float32)),
        )

    def __len__(self) -> int:
        return len(self.clouds)

    def draw(self, chosen: Tensor, segments: bool, generator: torch.Generator) -> CloudBatch:
        """Return clouds of scenes (B,), or of one segment of each, with noise, and their grasps."""
        parts = [self._draw_one(int(scene), segments, generator) for scene in chosen]
        return CloudBatch(*(torch.stack(each) for each in zip(*parts, strict=True)))

    def _draw_one(
        self, scene: int, segments: bool, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        points, weights = self.clouds[scene], self.weights[scene]
        if segments:
            points, weights = self._segment(scene, generator)
        low, high = NOISE_M
        std_m = low + (high - low) * float(torch.rand((), generator=generator))
        points = points + std_m * torch.randn(points.shape, generator=generator)
        cloud, middle = scaled_cloud(drawn_points(points, CLOUD_POINTS, generator))
        X_WGs = self.X_WGs[scene, torch.multinomial(weights, GRASPS, True, generator=generator)]
        # A gripper after half a turn about z is the same.
        sign = 1.0 - 2.0 * torch.randint(2, (GRASPS, 1, 1), generator=generator)
        signs = torch.cat([sign, sign, torch.ones_like(sign)], -1)
        return cloud, X_WGs[:, :3, :3] * signs, SCALE * (X_WGs[:, :3, 3] - middle)

    def _segment(self, scene: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Return points of a segment that has a true grasp, and the weights of its grasps."""
        points, weights = self.clouds[scene], self.weights[scene]
        X_WGs = self.X_WGs[scene].numpy()
        kept = list(_owned(points.numpy(), X_WGs, weights.numpy()))
        if not kept:  # specks alone are no segment
            return points, weights
        own, of_grasp = kept[int(torch.randint(len(kept), (), generator=generator))]
        return points[own], weights * torch.from_numpy(of_grasp)


def _owned(points: Array, X_WGs: Array, weights: Array) -> Iterator[tuple[Mask, Mask]]:
    """Yield which points (P,) and grasps (L,) belong to each segment with a true grasp."""
    found = objects_in_view(points)
    owner = owners(X_WGs, found) if found else np.zeros(0, int)
    for number, each in enumerate(found):
        of_grasp = owner == number
        if (weights[of_grasp] > 0.0).any():
            yield each.points, of_grasp
