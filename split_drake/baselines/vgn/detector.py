"""Grasps by VGN from the depth views of a scene."""

import torch

from split_drake.baselines.selection import SelectionConfig, Volume, VolumeGrasps
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.baselines.volume_detector import VolumeDetector

# As GIGA's public code runs both methods, but for what is free space, which is VGN's own.
SELECTION = SelectionConfig(
    threshold=0.90, fallback_threshold=0.5, free=0.5, border_m=0.02, lowest_m=0.055
)


class VgnDetector(VolumeDetector):
    """Grasps by VGN.

    Args:
        network: what it predicts with.
        selection: how grasps are chosen.
    """

    name = "VGN"

    def __init__(self, network: VgnNetwork, selection: SelectionConfig = SELECTION) -> None:
        super().__init__(selection)
        self._network = network.eval()

    @torch.inference_mode()
    def predict(self, field: Volume) -> VolumeGrasps:
        """Return what the network says of each voxel."""
        found = self._network(torch.tensor(field)[None])
        return VolumeGrasps(*(each[0].numpy() for each in found))
