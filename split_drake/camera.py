"""Depth views: a depth image, the camera's intrinsics, and its pose."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from split_drake.bad_input import BadInputError, require_count, require_number
from split_drake.poses import Array, check_poses, invert_pose, make_pose, nearest_pose

# A camera looking at a table from further away than this was given in millimetres.
MAX_PLAUSIBLE_DEPTH_M = 20.0
# What 16 bits of millimetres end with; cameras mark by it what they did not see.
_SATURATED_M = 65.535
MAX_PIXELS = 20000


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
        require_count("width", self.width, 1, MAX_PIXELS)
        require_count("height", self.height, 1, MAX_PIXELS)
        for name in ("fx", "fy", "cx", "cy"):
            require_number(name, getattr(self, name), meaning="in pixels")
        if not (self.fx > 0.0 and self.fy > 0.0):
            raise BadInputError(
                f"focal lengths fx={self.fx}, fy={self.fy}; expected positive pixels"
            )

    @classmethod
    def centered(cls, width: int, height: int, focal_px: float) -> "Intrinsics":
        """Return square pixels with the principal point in the middle of the image."""
        return cls(width, height, focal_px, focal_px, (width - 1) / 2.0, (height - 1) / 2.0)

    @classmethod
    def from_matrix(cls, K: ArrayLike, size: tuple[int, int]) -> "Intrinsics":
        """Return the intrinsics of a camera matrix K (3, 3) and an image size (width, height).

        Raises BadInputError where K is no camera matrix, or has skew.
        """
        matrix = np.asarray(K, dtype=float)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise BadInputError(f"K is {matrix.tolist()}; expected a (3, 3) camera matrix")
        if np.any(matrix[(0, 1, 2, 2), (1, 0, 0, 1)]) or matrix[2, 2] != 1.0:
            raise BadInputError(
                f"K is {matrix.tolist()}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
            )
        (fx, _, cx), (_, fy, cy) = matrix[:2].tolist()
        return cls(*size, fx, fy, cx, cy)

    def window(self, p_CPs: Array) -> tuple[slice, slice]:
        """Return the rows and columns of the image that points (N, 3) in C cover.

        Raises ValueError where one lies behind the camera.
        """
        x, y, z = p_CPs.T
        if z.min() <= 0.0:
            raise ValueError(f"what is to be seen reaches {-z.min():.3f} m behind the camera")
        u = x / z * self.fx + self.cx
        v = y / z * self.fy + self.cy
        rows = np.clip([np.floor(v.min()), np.ceil(v.max()) + 1], 0, self.height)
        columns = np.clip([np.floor(u.min()), np.ceil(u.max()) + 1], 0, self.width)
        return slice(*rows.astype(int).tolist()), slice(*columns.astype(int).tolist())

    def cropped(self, window: tuple[slice, slice]) -> "Intrinsics":
        """Return the intrinsics of a rectangle, rows and columns, of the image."""
        rows, columns = window
        return replace(
            self,
            width=columns.stop - columns.start,
            height=rows.stop - rows.start,
            cx=self.cx - columns.start,
            cy=self.cy - rows.start,
        )


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
        depth_m: (H, W) depth along z_C in metres; 0 where the camera saw nothing.  It may be given
            as inf, NaN or 65.535 (the largest of 16 bits, in millimetres) there.
        intrinsics: of the camera.
        X_WC: (4, 4) pose of the camera in the world; see `poses.nearest_pose`.

    Raises ValueError where the image has another size than the intrinsics say, holds negative
    values, looks like millimetres, or where X_WC is no pose.
    """

    depth_m: NDArray[np.float32]
    intrinsics: Intrinsics
    X_WC: Array

    def __post_init__(self) -> None:
        depth = np.asarray(self.depth_m, dtype=np.float32)
        expected = (self.intrinsics.height, self.intrinsics.width)
        if depth.shape != expected:
            raise ValueError(f"depth_m has shape {depth.shape}; the intrinsics say {expected}")
        if (depth < 0.0).any():
            raise ValueError(f"depth_m reaches {np.nanmin(depth):g}; expected metres >= 0")
        depth = np.where(np.isfinite(depth) & (np.abs(depth - _SATURATED_M) > 1e-4), depth, 0.0)
        depth = depth.astype(np.float32)
        seen = depth[depth > 0.0]
        if seen.size and np.median(seen) > MAX_PLAUSIBLE_DEPTH_M:
            raise ValueError(
                f"the median of depth_m is {np.median(seen):g}, which looks like millimetres; "
                f"expected metres (below {MAX_PLAUSIBLE_DEPTH_M:g})"
            )
        X_WC = nearest_pose(self.X_WC, "X_WC")
        object.__setattr__(self, "depth_m", depth)
        object.__setattr__(self, "X_WC", X_WC)

    def masked(self, hidden: ArrayLike) -> "DepthView":
        """Return the view without the pixels that `hidden` (H, W), booleans, marks: a robot's arm.

        Raises BadInputError where the mask has another shape or type.
        """
        mask = np.asarray(hidden)
        if mask.shape != self.depth_m.shape or mask.dtype != bool:
            raise BadInputError(
                f"the mask has shape {mask.shape} and type {mask.dtype}; expected "
                f"{self.depth_m.shape} booleans, true where nothing is to be seen"
            )
        return replace(self, depth_m=np.where(mask, np.float32(0.0), self.depth_m))

    def points(self, min_z_m: float = -np.inf, stride_px: int = 1) -> Array:
        """Return the points seen above z = `min_z_m`, (N, 3) in W, row by row.

        Pixels that saw nothing are left out, and all but one of `stride_px` each way.
        """
        every = np.s_[::stride_px, ::stride_px]
        rays, depth_m = pixel_rays(self.intrinsics)[every], self.depth_m[every]
        z_W = self.X_WC[2].astype(np.float32)
        # Heights come first and in single precision: most pixels show the table.
        above = (rays @ z_W[:3]) * depth_m + z_W[3] > min_z_m
        seen = above & (depth_m > 0.0)
        p_CPs = rays[seen] * depth_m[seen, None]
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
    return check_poses(make_pose(np.column_stack([x, np.cross(z, x), z]), p_WC), "the view's pose")
