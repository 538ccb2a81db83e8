"""What SE(3)-DiffusionFields learns: an energy whose gradient takes noise off grasps."""

from pathlib import Path

import torch
from torch import Tensor

from split_drake.baselines.learning.cloud_lessons import GRASPS, CloudScenes
from split_drake.baselines.learning.method import Lessons, Method
from split_drake.baselines.se3dif.diffusion import denoising_loss
from split_drake.baselines.se3dif.network import Se3DifNetwork
from split_drake.data.dataset import SceneDataset
from split_drake.training.precision import uses_bfloat16


class Se3DifLessons(Lessons):
    """The network, and the clouds that it learns from: of whole scenes, or of their segments."""

    network: Se3DifNetwork

    def __init__(self, scenes: CloudScenes, segments: bool) -> None:
        self._scenes, self._segments = scenes, segments
        self.network = Se3DifNetwork()
        self.bfloat16 = uses_bfloat16("auto")

    def __len__(self) -> int:
        return len(self._scenes)

    def losses(
        self, chosen: Tensor, generator: torch.Generator, training: bool
    ) -> dict[str, Tensor]:
        batch = self._scenes.draw(chosen, self._segments, generator)
        R, p = batch.R.flatten(0, 1), batch.p.flatten(0, 1)
        self.network.in_bfloat16 = self.bfloat16 and training
        code = self.network.encode(batch.points).repeat_interleave(GRASPS, 0)
        return {"denoising": denoising_loss(self.network, code, R, p, generator)}


def prepare(dataset: SceneDataset, fields: Path | None, segments: bool = False) -> Se3DifLessons:
    """Return the lessons of a dataset; fields are not needed."""
    return Se3DifLessons(CloudScenes.of(dataset), segments)


METHOD = Method("se3dif", {"": 5e-4, "encoder": 1e-3}, scenes=2, prepare=prepare)
