"""Close-ups: what depth images say of the cells of a box around a grasp, in the hand's axes.

The clouds that SPLIT's grids are made of have 2000 points of a whole scene.  A depth image has a
point each millimetre, and tells what is free from what is hidden: a cell's signed distance along
its ray, as truncated signed distance fields have it (Curless and Levoy, "A volumetric method for
building complex models from range images", 1996).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    """A depth image, or a part of one, ready to be looked up.

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
    def of(cls, view: DepthView, p_WShowns: Array) -> Self | None:
        """Return the part of a view that shows points (N, 3), with its noise as it is.

        None where they lie outside of the image.
        """
        whole = view.intrinsics
        p_CShowns = transform_points(invert_pose(view.X_WC), p_WShowns)
        window = (slice(0, whole.height), slice(0, whole.width))
        if p_CShowns[:, 2].min() > 0.0:  # or else the camera is among them
            window = whole.window(p_CShowns)
        if any(part.stop <= part.start for part in window):
            return None
        shown = whole.cropped(window)
        return cls(
            torch.tensor(np.ascontiguousarray(view.depth_m[window])),
            torch.tensor([shown.fx, shown.fy], dtype=torch.float32),
            torch.tensor([shown.cx, shown.cy], dtype=torch.float32),
            torch.tensor(view.X_WC, dtype=torch.float32),
        )

    def smoothed(self) -> Self:
        """Return the image with less noise."""
        return replace(self, depth_m=smoothed(self.depth_m))

    def distances(self, X_WGs: Tensor, p_GQs: Tensor) -> tuple[Tensor, Tensor]:
        """Return how far before the surface that is seen points lie, along z of C, (N, P).

        Negative for what lies behind it.  Then whether that is known: 0 is given where it is not.

        Args:
            X_WGs: (N, 4, 4).
            p_GQs: (P, 3) points in each of these frames.
        """
        height, width = self.depth_m.shape
        R_CW = self.X_WC[:3, :3].T
        p_CGs = R_CW @ (X_WGs[:, :3, 3:] - self.X_WC[:3, 3:])
        x, y, z = (R_CW @ X_WGs[:, :3, :3] @ p_GQs.T + p_CGs).unbind(1)
        before = z > 0.0
        near = z.clamp_min(1e-6)
        # A frame of pixels that saw nothing stands for all that is outside of the image.
        framed = functional.pad(self.depth_m, [1] * 4).flatten()
        u = (x / near).mul_(self.focal_px[0]).add_(self.center_px[0] + 1.0).round_()
        v = (y / near).mul_(self.focal_px[1]).add_(self.center_px[1] + 1.0).round_()
        pixels = v.clamp_(0, height + 1).mul_(width + 2).add_(u.clamp_(0, width + 1)).int()
        depth_m = framed[pixels]
        known = before & (depth_m > 0.0)
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
    p_GQs = cell_middles(config)
    before_m = torch.full((len(X_WGs), len(p_GQs)), -torch.inf)
    for image in images:
        distances_m, known = image.distances(X_WGs, p_GQs)
        before_m = torch.where(known, before_m.maximum(distances_m), before_m)
    shown = before_m.isfinite()
    before_m = torch.where(shown, before_m, 0.0)
    heights_m = X_WGs[:, 2, :3] @ p_GQs.T + (X_WGs[:, 2, 3:] - table_z_m)
    channels = (
        before_m / config.fine_m,
        before_m / config.coarse_m,
        (~shown).float(),
        heights_m / HEIGHT_M,
    )
    # In PyTorch's "channels last", as the network's convolutions want them.
    cells = torch.stack(channels, -1).clamp_(-1.0, 1.0).view(-1, *config.cells, CHANNELS)
    return cells.permute(0, 4, 1, 2, 3)


def shown_by(
    views: Sequence[DepthView], workspace: Workspace, X_WGs: Array, config: CloseUpConfig
) -> Tensor:
    """Return close-ups (N, 4, nx, ny, nz) of grasps (N, 4, 4), N > 0, in what views show."""
    half = (np.array(config.cells) - 1) / 2.0 * config.spacing_m
    p_GMiddle = np.array([0.0, 0.0, config.middle_z_m])
    p_GCorners = trimesh.bounds.corners([p_GMiddle - half, p_GMiddle + half])
    p_WCorners = (p_GCorners @ X_WGs[:, :3, :3].mT + X_WGs[:, None, :3, 3]).reshape(-1, 3)
    showing = [DepthTensor.of(view, p_WCorners) for view in views]
    images = [each.smoothed() for each in showing if each is not None]
    poses = torch.tensor(X_WGs, dtype=torch.float32)
    return close_ups(images, poses, workspace.p_WCenter[2], config)
