"""The U-Net that GIGA refines its planes of features with.

Ronneberger, Fischer and Brox, "U-Net: convolutional networks for biomedical image segmentation"
(2015).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional


class UNet(nn.Module):
    """Convolutions down and up again, each level's features handed across.

    The parameters have the names that GIGA's published weights have.

    Args:
        channels: of input, output and the first level; each further level has twice as many.
        depth: levels.
    """

    def __init__(self, channels: int, depth: int) -> None:
        super().__init__()
        widths = [channels * 2**level for level in range(depth)]
        inputs = [channels, *widths[:-1]]
        self.down_convs = nn.ModuleList(
            _TwoConvolutions(few, many) for few, many in zip(inputs, widths, strict=True)
        )
        self.up_convs = nn.ModuleList(
            _Up(many, few) for many, few in zip(widths[:0:-1], widths[-2::-1], strict=True)
        )
        self.conv_final = nn.Conv2d(channels, channels, 1)

    def forward(self, planes: Tensor) -> Tensor:
        """Return planes (B, C, r, r) of the same shape; r is a multiple of 2^(depth - 1)."""
        across: list[Tensor] = []
        for level, down in enumerate(self.down_convs):
            if level:
                planes = functional.max_pool2d(planes, 2)
            planes = down(planes)
            across.append(planes)
        for up, same_level in zip(self.up_convs, across[-2::-1], strict=True):
            planes = up(planes, same_level)
        refined: Tensor = self.conv_final(planes)
        return refined


class _TwoConvolutions(nn.Module):
    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, padding=1)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1)

    def forward(self, planes: Tensor) -> Tensor:
        return functional.relu(self.conv2(functional.relu(self.conv1(planes))))


class _Up(nn.Module):
    """One level up: enlarged, joined with what that level had on the way down."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.upconv = nn.ConvTranspose2d(inputs, outputs, 2, stride=2)
        self.conv1 = nn.Conv2d(2 * outputs, outputs, 3, padding=1)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1)

    def forward(self, planes: Tensor, same_level: Tensor) -> Tensor:
        both = torch.cat([self.upconv(planes), same_level], dim=1)
        return functional.relu(self.conv2(functional.relu(self.conv1(both))))
