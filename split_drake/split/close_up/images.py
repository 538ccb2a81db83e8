"""Close-ups: what depth images say of the cells of a box around a grasp, in the hand's axes.

The clouds that SPLIT's grids are made of have 2000 points of a whole scene.  A depth image has a
point each millimetre, and tells what is free from what is hidden: a cell's signed distance along
its ray, as truncated signed distance fields have it (Curless and Levoy, "A volumetric method for
building complex models from range images", 1996).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
import trimesh
from torch import Tensor
from torch.nn import functional

from split_drake.camera import DepthView
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.scene import Workspace
from split_drake.split.close_up.config import CHANNELS, CloseUpConfig

# A pixel takes the mean of those within so many pixels whose depth differs by less, some times:
# less noise, and rims stay where they are.
SMOOTHED_PX, SMOOTHED_M, SMOOTHINGS = 2, 0.015, 2
# Heights above the table are told up to this.
HEIGHT_M = 0.02


@dataclass(frozen=True)
class DepthTensor:
    """A depth image of a workspace, ready to be looked up.

    Attributes:
        depth_m: (H, W) along z of C; 0 where nothing was seen.
        focal_px, center_px: (2,) of x and y.
        X_WC: (4, 4).
    """

    depth_m: Tensor
    focal_px: Tensor
    center_px: Tensor
    X_WC: Tensor

    @classmethod
    def of(cls, view: DepthView, workspace: Workspace) -> Self:
        """Return the part of a view that shows a workspace, with its noise as it is.

        Raises ValueError where a corner of the workspace lies behind the camera.
        """
        low = workspace.p_WV
        corners = trimesh.bounds.corners([low, low + workspace.edge_m])
        window = view.intrinsics.window(transform_points(invert_pose(view.X_WC), corners))
        shown = view.intrinsics.cropped(window)
        return cls(
            torch.tensor(np.ascontiguousarray(view.depth_m[window])),
            torch.tensor([shown.fx, shown.fy], dtype=torch.float32),
            torch.tensor([shown.cx, shown.cy], dtype=torch.float32),
            torch.tensor(view.X_WC, dtype=torch.float32),
        )

    def distances(self, p_WQs: Tensor) -> tuple[Tensor, Tensor]:
        """Return how far before the surface that is seen points (..., 3) in W lie, along z of C.

        Negative for what lies behind it.  Then whether that is known: 0 is given where it is not.
        """
        height, width = self.depth_m.shape
        p_CQs = (p_WQs - self.X_WC[:3, 3]) @ self.X_WC[:3, :3]
        z = p_CQs[..., 2]
        pixels = (p_CQs[..., :2] / z[..., None] * self.focal_px + self.center_px).round().long()
        u, v = pixels.unbind(-1)
        inside = (z > 0.0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        depth_m = self.depth_m.flatten()[torch.where(inside, v * width + u, 0)]
        known = inside & (depth_m > 0.0)
        return torch.where(known, depth_m - z, 0.0), known


def smoothed(depth_m: Tensor) -> Tensor:
    """Return a depth image (H, W) with less noise; 0, where nothing was seen, stays so.

    It is a bilateral filter (Tomasi and Manduchi, 1998) whose weights are 0 or 1.
    """
    height, width = depth_m.shape
    seen, size = depth_m > 0.0, 2 * SMOOTHED_PX + 1
    for _ in range(SMOOTHINGS):
        padded = functional.pad(depth_m[None, None], [SMOOTHED_PX] * 4)[0, 0]
        total, count = torch.zeros_like(depth_m), torch.zeros_like(depth_m)
        for row in range(size):
            for column in range(size):
                difference = padded[row : row + height, column : column + width] - depth_m
                near = (difference.abs() < SMOOTHED_M).to(depth_m.dtype)
                total.addcmul_(near, difference)
                count += near
        # A pixel is near itself, so that no count is 0.
        depth_m = torch.where(seen, depth_m + total / count, depth_m)
    return depth_m


def cell_middles(config: CloseUpConfig) -> Tensor:
    """Return the middles (nx * ny * nz, 3) of the cells in G, in the order [x, y, z]."""
    middles = (0.0, 0.0, config.middle_z_m)
    axes = [
        (torch.arange(count) - (count - 1) / 2.0) * spacing_m + middle_m
        for count, spacing_m, middle_m in zip(config.cells, config.spacing_m, middles, strict=True)
    ]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def close_ups(
    images: Sequence[DepthTensor], X_WGs: Tensor, table_z_m: float, config: CloseUpConfig
) -> Tensor:
    """Return close-ups (N, 4, nx, ny, nz) of grasps (N, 4, 4), in [-1, 1].

    The channels are the distance before the surface, up to `fine_m` and up to `coarse_m`; 1 where
    no image shows the cell; and its height above the table.  Where several images show a cell, that
    counts in which it lies furthest before the surface: what one of them sees through is free.
    """
    p_WQs = X_WGs[:, None, :3, 3] + cell_middles(config) @ X_WGs[:, :3, :3].mT
    before_m = torch.full(p_WQs.shape[:2], -torch.inf)
    for image in images:
        distances_m, known = image.distances(p_WQs)
        before_m = torch.where(known, before_m.maximum(distances_m), before_m)
    shown = before_m.isfinite()
    before_m = torch.where(shown, before_m, 0.0)
    channels = (
        before_m / config.fine_m,
        before_m / config.coarse_m,
        (~shown).float(),
        (p_WQs[..., 2] - table_z_m) / HEIGHT_M,
    )
    return torch.stack(channels, 1).clamp_(-1.0, 1.0).view(-1, CHANNELS, *config.cells)


def shown_by(
    views: Sequence[DepthView], workspace: Workspace, X_WGs: Array, config: CloseUpConfig
) -> Tensor:
    """Return close-ups (N, 4, nx, ny, nz) of grasps (N, 4, 4) in what views show of a workspace."""
    images = [DepthTensor.of(view, workspace) for view in views]
    calm = [
        DepthTensor(smoothed(each.depth_m), each.focal_px, each.center_px, each.X_WC)
        for each in images
    ]
    poses = torch.tensor(X_WGs, dtype=torch.float32)
    return close_ups(calm, poses, workspace.p_WCenter[2], config)
