"""What GIGA learns: how palms grasp, and what is within an object."""

from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from split_drake.baselines.giga.network import GigaNetwork
from split_drake.baselines.learning.grasp_loss import grasp_losses
from split_drake.baselines.learning.method import Lessons, Method
from split_drake.baselines.learning.volume_lessons import VolumeScenes
from split_drake.baselines.tsdf import RESOLUTION
from split_drake.data.dataset import SceneDataset

OCCUPANCY_POINTS = 2048


class GigaLessons(Lessons):
    """GIGA's network, and the scenes that it learns from.  It is trained without augmentation."""

    network: GigaNetwork

    def __init__(self, scenes: VolumeScenes) -> None:
        self._scenes = scenes
        self.network = GigaNetwork()

    def __len__(self) -> int:
        return len(self._scenes)

    def losses(
        self, chosen: Tensor, generator: torch.Generator, training: bool
    ) -> dict[str, Tensor]:
        palms = self._scenes.draw(chosen, generator)
        points, occupied = self._scenes.draw_points(chosen, OCCUPANCY_POINTS, generator)
        planes = self.network.encode(palms.fields)
        found = self.network.grasps(planes, _in_cube(palms.voxels))
        logits = self.network.occupancy(planes, _in_cube(points))
        entropy = functional.binary_cross_entropy_with_logits(logits, occupied)
        losses = grasp_losses(found.quality, found.quaternion_xyzw, RESOLUTION * found.width, palms)
        return {**losses, "occupancy": entropy}


def _in_cube(voxels: Tensor) -> Tensor:
    """Return positions in voxels as the network has them, in [-0.5, 0.5]."""
    return voxels / RESOLUTION - 0.5


def prepare(dataset: SceneDataset, fields: Path | None) -> GigaLessons:
    """Return GIGA's lessons; errors as of `VolumeScenes.of`."""
    return GigaLessons(VolumeScenes.of(dataset, fields))


METHOD = Method("giga", {"": 2e-4}, scenes=8, prepare=prepare)
