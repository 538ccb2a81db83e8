"""VGN's network: from a TSDF to a grasp in each voxel (arXiv 2101.01132, section IV-A)."""

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

RESOLUTION = 40
_ENCODER = ((1, 16, 5), (16, 32, 3), (32, 64, 3))
_DECODER = ((64, 64, 3), (64, 32, 3), (32, 16, 5))
_DECODED_SIZES = (10, 20, 40)
_HEAD_KERNEL = 5


class VoxelGrasps(NamedTuple):
    """A grasp for each voxel of a batch.

    Attributes:
        quality: (B, r, r, r) in [0, 1]; or (B, N), of voxels that were asked for.
        quaternion_xyzw: (B, r, r, r, 4) of unit length, of the palm in the volume's frame.
        width_voxels: (B, r, r, r) opening.
    """

    quality: Tensor
    quaternion_xyzw: Tensor
    width_voxels: Tensor


class VgnNetwork(nn.Module):
    """Strided 3D convolutions down to 5 voxels an edge, and back up to 40 by interpolation.

    The parameters have the names that the authors' published weights have.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = _convolutions(_ENCODER, stride=2)
        self.decoder = _convolutions(_DECODER, stride=1)
        channels = _DECODER[-1][1]
        self.conv_qual = _convolution(channels, 1, _HEAD_KERNEL)
        self.conv_rot = _convolution(channels, 4, _HEAD_KERNEL)
        self.conv_width = _convolution(channels, 1, _HEAD_KERNEL)

    def forward(self, tsdf: Tensor) -> VoxelGrasps:
        """Return grasps for fields (B, r, r, r) of r = 40."""
        features = self._features(tsdf)
        return VoxelGrasps(
            torch.sigmoid(self.conv_qual(features))[:, 0],
            functional.normalize(self.conv_rot(features), dim=1).movedim(1, -1),
            self.conv_width(features)[:, 0],
        )

    def at(self, tsdf: Tensor, voxels: Tensor) -> VoxelGrasps:
        """Return grasps at voxels (B, N, 3) alone, indices in [0, r); the batch is (B, N).

        That is what `forward` says there, for less work where N is small.
        """
        around = _HEAD_KERNEL // 2
        features = functional.pad(self._features(tsdf), (around,) * 6)
        line = torch.arange(_HEAD_KERNEL, device=voxels.device)
        steps = torch.cartesian_prod(line, line, line)
        x, y, z = (voxels[:, :, None] + steps).unbind(-1)
        scene = torch.arange(len(voxels), device=voxels.device)[:, None, None]
        seen = features.movedim(1, -1)[scene, x, y, z]
        heads = (self.conv_qual, self.conv_rot, self.conv_width)
        quality, quaternion, width = (_applied(head, seen) for head in heads)
        return VoxelGrasps(
            torch.sigmoid(quality)[..., 0], functional.normalize(quaternion, dim=-1), width[..., 0]
        )

    def _features(self, tsdf: Tensor) -> Tensor:
        """Return what the heads see of fields (B, r, r, r): (B, C, r, r, r)."""
        if tsdf.shape[1:] != (RESOLUTION,) * 3:
            raise ValueError(f"tsdf has shape {tuple(tsdf.shape)}; expected (B, 40, 40, 40)")
        features = tsdf[:, None]
        for convolution in self.encoder.children():
            features = functional.relu(convolution(features))
        for convolution, size in zip(self.decoder.children(), _DECODED_SIZES, strict=True):
            features = functional.relu(convolution(features))
            features = functional.interpolate(features, size)
        return features


def _applied(head: nn.Conv3d, seen: Tensor) -> Tensor:
    """Return what a head makes (B, N, outputs) of what is seen in its kernel, (B, N, k^3, C)."""
    weight = head.weight.flatten(2).transpose(1, 2).flatten(1)
    return functional.linear(seen.flatten(2), weight, head.bias)


def _convolutions(layers: tuple[tuple[int, int, int], ...], stride: int) -> nn.Module:
    """Return convolutions named conv1, conv2, ..."""
    room = nn.Module()
    for number, (inputs, outputs, kernel) in enumerate(layers, start=1):
        room.add_module(f"conv{number}", _convolution(inputs, outputs, kernel, stride))
    return room


def _convolution(inputs: int, outputs: int, kernel: int, stride: int = 1) -> nn.Conv3d:
    return nn.Conv3d(inputs, outputs, kernel, stride=stride, padding=kernel // 2)
