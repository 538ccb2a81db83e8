"""The network that judges close-ups of grasps."""

import torch
from torch import Tensor, nn

from split_drake.split.close_up.config import CHANNELS, CloseUpConfig


class CloseUpNetwork(nn.Module):
    """Four 3D convolutions and three layers.

    A hand is its own mirror image across both planes through its approach.  The network learns it,
    being shown all four in training; its answers for them differ a little.
    """

    def __init__(self, config: CloseUpConfig) -> None:
        super().__init__()
        self.config = config
        layers: list[nn.Module] = []
        inputs = CHANNELS
        for outputs, stride in zip(config.channels, (2, 1, 2, 1), strict=True):
            layers += [nn.Conv3d(inputs, outputs, 3, stride=stride, padding=1), nn.ReLU()]
            inputs = outputs
        self.convolutions = nn.Sequential(*layers)
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Linear(inputs * config.cells_after, config.width),
            nn.ReLU(),
            nn.Linear(config.width, config.width),
            nn.ReLU(),
            nn.Linear(config.width, 1),
        )

    def forward(self, close_ups: Tensor) -> Tensor:
        """Return logits (N,) that the grasps hold whose close-ups (N, 4, nx, ny, nz) are given."""
        x = close_ups.contiguous(memory_format=torch.channels_last_3d)
        logits: Tensor = self.head(self.convolutions(x))[:, 0]
        return logits
