"""What VGN learns: of each labelled voxel, whether and how a palm there grasps."""

from pathlib import Path

import torch
from torch import Tensor

from split_drake.baselines.learning.grasp_loss import grasp_losses
from split_drake.baselines.learning.method import Lessons, Method
from split_drake.baselines.learning.turning import raised, turned
from split_drake.baselines.learning.volume_lessons import VolumeScenes
from split_drake.baselines.tsdf import RESOLUTION
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.data.dataset import SceneDataset


class VgnLessons(Lessons):
    """VGN's network, and the scenes that it learns from."""

    network: VgnNetwork

    def __init__(self, scenes: VolumeScenes) -> None:
        self._scenes = scenes
        self.network = VgnNetwork()

    def __len__(self) -> int:
        return len(self._scenes)

    def losses(
        self, chosen: Tensor, generator: torch.Generator, training: bool
    ) -> dict[str, Tensor]:
        palms = self._scenes.draw(chosen, generator)
        if training:
            palms = raised(turned(palms, generator), generator)
        voxels = palms.voxels.round().long().clamp(0, RESOLUTION - 1)
        return grasp_losses(*self.network.at(palms.fields, voxels), palms)


def prepare(dataset: SceneDataset, fields: Path | None) -> VgnLessons:
    """Return VGN's lessons; errors as of `VolumeScenes.of`."""
    return VgnLessons(VolumeScenes.of(dataset, fields))


METHOD = Method("vgn", {"": 3e-4}, scenes=8, prepare=prepare)
