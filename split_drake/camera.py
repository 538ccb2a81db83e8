"""Depth views: a depth image, the camera's intrinsics, and its pose."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from split_drake.poses import Array, check_poses, invert_pose, make_pose

# A camera looking at a table from further away than this was given in millimetres.
MAX_PLAUSIBLE_DEPTH_M = 20.0


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; pixel centres lie at whole numbers (as in OpenCV).

    Attributes:
        width, height: pixels.
        fx, fy: focal lengths in pixels.
        cx, cy: principal point in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image size {self.width} x {self.height}; expected positive numbers")
        if not (self.fx > 0.0 and self.fy > 0.0):
            raise ValueError(f"focal lengths fx={self.fx}, fy={self.fy}; expected positive pixels")

    @classmethod
    def centered(cls, width: int, height: int, focal_px: float) -> "Intrinsics":
        """Return square pixels with the principal point in the middle of the image."""
        return cls(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0)


@lru_cache(maxsize=8)
def pixel_rays(intrinsics: Intrinsics) -> NDArray[np.float32]:
    """Return (H, W, 3) rays in C through the pixels' centres, scaled to depth 1."""
    u, v = np.meshgrid(np.arange(intrinsics.width), np.arange(intrinsics.height))
    x = (u - intrinsics.cx) / intrinsics.fx
    y = (v - intrinsics.cy) / intrinsics.fy
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32)
    rays.setflags(write=False)
    return rays


@dataclass(frozen=True)
class DepthView:
    """One depth image and where it was taken from.

    Attributes:
        depth_m: (H, W) depth along z_C in metres; 0 or inf where the camera saw nothing.
        intrinsics: of the camera.
        X_WC: (4, 4) pose of the camera in the world.

    Raises ValueError where the image has another size than the intrinsics say, holds NaN or
    negative values, looks like millimetres, or where X_WC is no pose.
    """

    depth_m: NDArray[np.float32]
    intrinsics: Intrinsics
    X_WC: Array

    def __post_init__(self) -> None:
        depth = np.asarray(self.depth_m, dtype=np.float32)
        expected = (self.intrinsics.height, self.intrinsics.width)
        if depth.shape != expected:
            raise ValueError(f"depth_m has shape {depth.shape}; the intrinsics say {expected}")
        if np.isnan(depth).any():
            count = int(np.isnan(depth).sum())
            raise ValueError(f"depth_m holds {count} NaN; mark missing pixels by 0 or inf")
        if (depth < 0.0).any():
            raise ValueError(f"depth_m reaches {depth.min():g}; expected metres >= 0")
        seen = depth[(depth > 0.0) & np.isfinite(depth)]
        if seen.size and np.median(seen) > MAX_PLAUSIBLE_DEPTH_M:
            raise ValueError(
                f"the median of depth_m is {np.median(seen):g}, which looks like millimetres; "
                f"expected metres (below {MAX_PLAUSIBLE_DEPTH_M:g})"
            )
        X_WC = check_poses(self.X_WC, "X_WC")
        if X_WC.shape != (4, 4):
            raise ValueError(f"X_WC has shape {X_WC.shape}; expected (4, 4)")
        object.__setattr__(self, "depth_m", depth)
        object.__setattr__(self, "X_WC", X_WC)

    def points(self, min_z_m: float = -np.inf) -> Array:
        """Return the points seen above z = `min_z_m`, (N, 3) in W, row by row.

        Pixels that saw nothing are left out.
        """
        rays, z_W = pixel_rays(self.intrinsics), self.X_WC[2].astype(np.float32)
        # Heights come first and in single precision: most pixels show the table.
        with np.errstate(invalid="ignore"):
            above = (rays @ z_W[:3]) * self.depth_m + z_W[3] > min_z_m
        seen = above & (self.depth_m > 0.0) & np.isfinite(self.depth_m)
        p_CPs = rays[seen] * self.depth_m[seen, None]
        return p_CPs @ self.X_WC[:3, :3].T + self.X_WC[:3, 3]


def project(p_WPs: Array, intrinsics: Intrinsics, X_WC: Array) -> Array:
    """Return the pixels (..., 2), u to the right and v down, of points (..., 3) in W.

    They must lie before the camera.
    """
    X_CW = invert_pose(X_WC)
    p_CPs = p_WPs @ X_CW[:3, :3].T + X_CW[:3, 3]
    scaled = p_CPs[..., :2] / p_CPs[..., 2:] * (intrinsics.fx, intrinsics.fy)
    return scaled + np.array([intrinsics.cx, intrinsics.cy])


def look_at(p_WC: ArrayLike, p_WTarget: ArrayLike, down_W: ArrayLike = (0.0, 0.0, -1.0)) -> Array:
    """Return X_WC of a camera at `p_WC` that looks at `p_WTarget`, the image's y towards `down_W`.

    Raises ValueError where the view is along `down_W` or the points coincide.
    """
    z = np.asarray(p_WTarget, dtype=float) - np.asarray(p_WC, dtype=float)
    x = np.cross(np.asarray(down_W, dtype=float), z)
    if np.linalg.norm(x) < 1e-9:
        raise ValueError(
            f"down_W={down_W!r} is parallel to the view from {p_WC!r} to {p_WTarget!r}"
        )
    z /= np.linalg.norm(z)
    x /= np.linalg.norm(x)
    return make_pose(np.column_stack([x, np.cross(z, x), z]), p_WC)
