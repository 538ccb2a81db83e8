"""Grasps by GIGA from the depth views of a scene."""

import torch

from split_drake.baselines.giga.network import RESOLUTION, GigaNetwork
from split_drake.baselines.selection import SelectionConfig, Volume, VolumeGrasps
from split_drake.baselines.volume_detector import VolumeDetector

# As in the runs that its public code has: the best grasp counts where none is very good.
SELECTION = SelectionConfig(
    threshold=0.90, fallback_threshold=0.5, free=0.1, border_m=0.02, lowest_m=0.055
)


class GigaDetector(VolumeDetector):
    """Grasps by GIGA.

    Args:
        network: what it predicts with, at the corner of every voxel.
        selection: how grasps are chosen.
    """

    name = "GIGA"

    def __init__(self, network: GigaNetwork, selection: SelectionConfig = SELECTION) -> None:
        super().__init__(selection)
        self._network = network.eval()
        self._points = _corners()

    @torch.inference_mode()
    def predict(self, field: Volume) -> VolumeGrasps:
        """Return what the network says at each voxel's corner."""
        found = self._network(torch.tensor(field)[None], self._points)
        quality, quaternion, width = (
            each[0].unflatten(0, (RESOLUTION,) * 3).numpy() for each in found
        )
        return VolumeGrasps(quality, quaternion, RESOLUTION * width)


def _corners() -> torch.Tensor:
    """Return the voxels' lowest corners (1, r^3, 3) in the cube [-0.5, 0.5]^3."""
    line = torch.arange(RESOLUTION) / RESOLUTION - 0.5
    grid = torch.stack(torch.meshgrid(line, line, line, indexing="ij"), dim=-1)
    return grid.reshape(1, -1, 3)
