"""GIGA's network: from a TSDF to the grasp and the occupancy at any point (arXiv 2104.01542, IV).

The features are those of convolutional occupancy networks (Peng et al. 2020, arXiv 2003.04618).
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from split_drake.baselines.giga.unet import UNet

RESOLUTION = 40
CHANNELS = 32
BLOCKS = 5
# Which two of x, y and z each plane has; the order in which their features are joined.
PLANES = ((0, 2), (0, 1), (1, 2))
# Keeps coordinates of points on the cube's far faces within the last pixel.
_MARGIN = 1e-5


class PointGrasps(NamedTuple):
    """A grasp for each of the points of a batch.

    Attributes:
        quality: (B, N) in [0, 1].
        quaternion_xyzw: (B, N, 4) of unit length, of the palm in the volume's frame.
        width: (B, N) opening, as a share of the cube's edge.
    """

    quality: Tensor
    quaternion_xyzw: Tensor
    width: Tensor


class GigaNetwork(nn.Module):
    """Planes of features, and decoders that read them at points.

    Points are in the cube [-0.5, 0.5]^3.  The parameters have the names that the authors' published
    weights have.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = PlaneEncoder()
        self.decoder_qual = PointDecoder(1)
        self.decoder_rot = PointDecoder(4)
        self.decoder_width = PointDecoder(1)
        self.decoder_tsdf = PointDecoder(1)

    def forward(self, tsdf: Tensor, points: Tensor) -> PointGrasps:
        """Return grasps at points (B, N, 3) for fields (B, r, r, r) of r = 40."""
        return self.grasps(self.encode(tsdf), points)

    def encode(self, tsdf: Tensor) -> tuple[Tensor, ...]:
        """Return a plane (B, C, r, r) of features for each of `PLANES`."""
        if tsdf.shape[1:] != (RESOLUTION,) * 3:
            raise ValueError(f"tsdf has shape {tuple(tsdf.shape)}; expected (B, 40, 40, 40)")
        planes: tuple[Tensor, ...] = self.encoder(tsdf)
        return planes

    def grasps(self, planes: Sequence[Tensor], points: Tensor) -> PointGrasps:
        """Return grasps at points (B, N, 3), of what `encode` returned."""
        features = read_planes(planes, points)
        return PointGrasps(
            torch.sigmoid(self.decoder_qual(points, features))[..., 0],
            functional.normalize(self.decoder_rot(points, features), dim=-1),
            self.decoder_width(points, features)[..., 0],
        )

    def occupancy(self, planes: Sequence[Tensor], points: Tensor) -> Tensor:
        """Return the logits (B, N) of points' (B, N, 3) being within an object."""
        logits: Tensor = self.decoder_tsdf(points, read_planes(planes, points))[..., 0]
        return logits


def read_planes(planes: Sequence[Tensor], points: Tensor) -> Tensor:
    """Return what planes (B, C, r, r) show at points (B, N, 3), joined, (B, N, 96)."""
    found = []
    for plane, axes in zip(planes, PLANES, strict=True):
        places = 2.0 * _within(points[..., axes])[:, :, None] - 1.0
        read = functional.grid_sample(plane, places, padding_mode="border", align_corners=True)
        found.append(read[..., 0].transpose(1, 2))
    return torch.cat(found, dim=-1)


class PlaneEncoder(nn.Module):
    """One convolution of the field, averaged onto three planes, which a shared U-Net refines."""

    def __init__(self) -> None:
        super().__init__()
        self.conv_in = nn.Conv3d(1, CHANNELS, 3, padding=1)
        self.unet = UNet(CHANNELS, depth=3)

    def forward(self, tsdf: Tensor) -> tuple[Tensor, ...]:
        """Return a plane (B, C, r, r) of features for each of `PLANES`, its first axis last."""
        voxels = functional.relu(self.conv_in(tsdf[:, None]))
        return tuple(self.unet(_averaged(voxels, axes)) for axes in PLANES)


def _averaged(voxels: Tensor, axes: tuple[int, int]) -> Tensor:
    """Return (B, C, r, r): the mean of the voxels (B, C, r, r, r) that fall onto each pixel.

    The plane has the first of the `axes` last.
    """
    (across,) = {0, 1, 2} - set(axes)
    columns = voxels.mean(2 + across).transpose(2, 3).flatten(2)
    pixels = _pixels(voxels.device)
    sums = columns.new_zeros(columns.shape).index_add(2, pixels, columns)
    counts = torch.bincount(pixels, minlength=RESOLUTION**2).clamp(min=1)
    return (sums / counts).unflatten(2, (RESOLUTION, RESOLUTION))


def _pixels(device: torch.device) -> Tensor:
    """Return the pixel (r^2,) of a plane that each column of voxels falls onto."""
    line = (_within(torch.linspace(-0.5, 0.5, RESOLUTION, device=device)) * RESOLUTION).long()
    second, first = torch.meshgrid(line, line, indexing="ij")
    return (first + RESOLUTION * second).flatten()


def _within(coordinates: Tensor) -> Tensor:
    """Return coordinates of [-0.5, 0.5] in [0, 1)."""
    return (coordinates / (1.0 + _MARGIN) + 0.5).clamp(0.0, 1.0 - _MARGIN)


class PointDecoder(nn.Module):
    """Five residual blocks; the features are added before each.

    Args:
        outputs: numbers for each point.
    """

    def __init__(self, outputs: int) -> None:
        super().__init__()
        self.fc_p = nn.Linear(3, CHANNELS)
        self.fc_c = nn.ModuleList(
            nn.Linear(CHANNELS * len(PLANES), CHANNELS) for _ in range(BLOCKS)
        )
        self.blocks = nn.ModuleList(_Residual() for _ in range(BLOCKS))
        self.fc_out = nn.Linear(CHANNELS, outputs)

    def forward(self, points: Tensor, features: Tensor) -> Tensor:
        """Return (B, N, outputs) for points (B, N, 3) and their features (B, N, 96)."""
        state = self.fc_p(points)
        for condition, block in zip(self.fc_c, self.blocks, strict=True):
            state = block(state + condition(features))
        answer: Tensor = self.fc_out(functional.relu(state))
        return answer


class _Residual(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.fc_0 = nn.Linear(CHANNELS, CHANNELS)
        self.fc_1 = nn.Linear(CHANNELS, CHANNELS)

    def forward(self, state: Tensor) -> Tensor:
        change: Tensor = self.fc_1(functional.relu(self.fc_0(functional.relu(state))))
        return state + change
