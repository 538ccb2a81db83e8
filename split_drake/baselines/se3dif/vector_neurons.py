"""A point cloud encoder whose features turn with the cloud.

Deng et al., "Vector neurons: a general framework for SO(3)-equivariant networks" (2021,
arXiv 2104.12229).  A feature is a vector of R^3, so that features have the shape (..., C, 3).
"""

import torch
from torch import Tensor, nn

NEIGHBOURS = 20
HIDDEN = 96
BLOCKS = 4
# Below this, a direction has no length worth dividing by.
_TINY = 1e-6


class VectorLinear(nn.Module):
    """Mixes features (..., C, 3) linearly, without a bias, which would not turn."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.map = nn.Linear(inputs, outputs, bias=False)

    def forward(self, features: Tensor) -> Tensor:
        """Return features (..., outputs, 3)."""
        mixed: Tensor = self.map(features.transpose(-1, -2))
        return mixed.transpose(-1, -2)


class VectorRelu(nn.Module):
    """Takes away what points against a learnt direction, which turns with the features."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.direction = VectorLinear(channels, channels)

    def forward(self, features: Tensor) -> Tensor:
        """Return features of the same shape."""
        direction = self.direction(features)
        along = (features * direction).sum(-1, keepdim=True)
        squared = direction.square().sum(-1, keepdim=True) + _TINY
        return features - along.clamp(max=0.0) / squared * direction


class VectorEncoder(nn.Module):
    """From a cloud to one code: a graph of neighbours, then blocks that mix in the cloud's mean.

    Args:
        latent: numbers in the code, a multiple of three.
    """

    def __init__(self, latent: int) -> None:
        super().__init__()
        self.of_edges = nn.Sequential(VectorLinear(3, HIDDEN), VectorRelu(HIDDEN))
        self.of_points = VectorLinear(HIDDEN, 2 * HIDDEN)
        self.blocks = nn.ModuleList(
            nn.Sequential(VectorRelu(2 * HIDDEN), VectorLinear(2 * HIDDEN, HIDDEN))
            for _ in range(BLOCKS)
        )
        self.to_code = nn.Sequential(VectorRelu(HIDDEN), VectorLinear(HIDDEN, latent // 3))

    def forward(self, points: Tensor) -> Tensor:
        """Return codes (B, latent) of clouds (B, N, 3), N > `NEIGHBOURS`."""
        features = self.of_points(self.of_edges(edges(points)).mean(2))
        for number, block in enumerate(self.blocks):
            features = block(features)
            if number < BLOCKS - 1:
                mean = features.mean(1, keepdim=True).expand_as(features)
                features = torch.cat([features, mean], 2)
        code: Tensor = self.to_code(features.mean(1))
        return code.flatten(1)


def edges(points: Tensor) -> Tensor:
    """Return (B, N, k, 3, 3): of each of points (B, N, 3) and its neighbours three vectors.

    They are the way to the neighbour, the point, and the cross product of both.
    """
    nearest = torch.cdist(points, points).topk(NEIGHBOURS, largest=False).indices
    batch = torch.arange(len(points), device=points.device)[:, None, None]
    neighbours, own = points[batch, nearest], points[:, :, None].expand(-1, -1, NEIGHBOURS, -1)
    return torch.stack([neighbours - own, own, torch.linalg.cross(neighbours, own)], 3)
