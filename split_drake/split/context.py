"""Local geometric context: scene features around a pose, along its own axes (paper IV-C)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

# Of a cell between eight centres.
CORNERS = [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]


def point_kernel(offset_m: float) -> Tensor:
    """Return the paper's seven points (7, 3): the centre, and +-offset along x, y and z."""
    axes = offset_m * torch.eye(3)
    return torch.cat([torch.zeros(1, 3), torch.stack([axes, -axes], 1).reshape(6, 3)])


def pose_numbers(X_VPs: Tensor, edge_m: float) -> Tensor:
    """Return position and rotation of poses (..., 4, 4) as numbers (..., 12) of about -1 to 1.

    First the position's three, -1 and 1 at the faces of the cube, then the rotation's nine by rows.
    """
    p_scaled = 2.0 * X_VPs[..., :3, 3] / edge_m - 1.0
    return torch.cat([p_scaled, X_VPs[..., :3, :3].flatten(-2)], -1)


def in_pose_axes(motions_V: Tensor, R_VPs: Tensor) -> Tensor:
    """Return the motions [v, omega] (..., 6) of poses, given in V's axes, in the poses' own.

    Both are motions of the pose's origin: only the axes change, by the rotations (..., 3, 3).
    """
    # Written out, as autocast would round the rotations of a matrix product.
    rows = motions_V.unflatten(-1, (2, 3))[..., None] * R_VPs[..., None, :, :]
    return rows.sum(-2).flatten(-2)


@dataclass(frozen=True)
class FeatureTables:
    """Feature grids of a batch of B scenes, one row per cell, ready to be looked up many times.

    A grid of n cells divides the cube evenly; a cell's features are those of its centre.  So the
    same surroundings give the same context wherever they are, up to the coarsest grid's cells.
    A grid of one cell is the same everywhere.

    Attributes:
        tables: for each grid, (B * n^3, C) rows in the order [scene, x, y, z].
        sizes: n of each grid.
        scenes: B.
        edge_m: edge of the cube that all the grids cover.
    """

    tables: tuple[Tensor, ...]
    sizes: tuple[int, ...]
    scenes: int
    edge_m: float

    @classmethod
    def from_grids(cls, grids: list[Tensor], edge_m: float) -> "FeatureTables":
        """Lay out `grids`, each (B, C, n, n, n) indexed [x, y, z]."""
        tables = tuple(
            grid.permute(0, 2, 3, 4, 1).reshape(-1, grid.shape[1]).float() for grid in grids
        )
        sizes = tuple(grid.shape[-1] for grid in grids)
        return cls(tables, sizes, len(grids[0]), edge_m)

    def only(self, numbers: Sequence[int]) -> "FeatureTables":
        """Return the tables with these numbers alone."""
        return replace(
            self,
            tables=tuple(self.tables[number] for number in numbers),
            sizes=tuple(self.sizes[number] for number in numbers),
        )

    def lookup(self, p_VQs: Tensor) -> Tensor:
        """Return features (B, Q, sum of C) at points (B, Q, 3) in V, metres.

        Interpolation is trilinear; points beyond the outermost cells take those cells' values.
        """
        share = p_VQs.reshape(-1, 3) / self.edge_m
        scene = torch.arange(self.scenes, device=p_VQs.device).repeat_interleave(p_VQs.shape[1])
        features = [
            self._lookup_grid(table, size, share, scene)
            for table, size in zip(self.tables, self.sizes, strict=True)
        ]
        return torch.cat(features, -1).view(*p_VQs.shape[:2], -1)

    @staticmethod
    def _lookup_grid(table: Tensor, size: int, share: Tensor, scene: Tensor) -> Tensor:
        """Return features (Q, C) of one grid at shares (Q, 3) of the edges of scenes (Q,)."""
        if size == 1:
            return table[scene]
        cells = (share * size - 0.5).clamp(0.0, size - 1.0)
        low = cells.floor().clamp(max=size - 2.0)
        high_share = cells - low
        shares = torch.stack([1.0 - high_share, high_share], -1)  # (Q, axis, low or high)
        x, y, z = shares.unbind(1)
        weights = (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).view(-1, 8)
        index = low.long()
        first = ((scene * size + index[:, 0]) * size + index[:, 1]) * size + index[:, 2]
        steps = torch.tensor([(a * size + b) * size + c for a, b, c in CORNERS])
        rows = first[:, None] + steps.to(first.device)
        return functional.embedding_bag(rows, table, per_sample_weights=weights, mode="sum")

    def around(self, X_VPs: Tensor, kernel: Tensor) -> Tensor:
        """Return contexts (B, N, K * sum of C) of poses (B, N, 4, 4) for kernel points (K, 3)."""
        p_VQs = X_VPs[..., None, :3, 3] + kernel @ X_VPs[..., :3, :3].transpose(-1, -2)
        return self.lookup(p_VQs.flatten(1, 2)).view(*X_VPs.shape[:2], -1)
