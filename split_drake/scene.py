"""Scenes: what the depth cameras saw of the workspace, as a cloud and as an occupancy grid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import fpsample
import numpy as np
from numpy.typing import ArrayLike, NDArray

from split_drake.bad_input import BadInputError, require_number, require_numbers
from split_drake.camera import DepthView
from split_drake.poses import Array

# Of points that any depth camera measures; more was given in millimetres.
MAX_NOISE_M = 0.1
# Clouds are kept with single precision, or less.
_ROUNDING_M = 1e-3


class EmptySceneError(BadInputError):
    """No depth pixel fell onto anything in the workspace."""


@dataclass(frozen=True)
class Workspace:
    """The cube that a scene is cropped to and its grid covers (paper section V).

    Attributes:
        p_WCenter: centre of the cube's footprint on the table, metres.
        edge_m: length of the cube's edges, which are parallel to those of W.
        depth_below_m: how far the cube reaches below the centre.
        table_clearance_m: points lower than this above the centre count as table.
    """

    p_WCenter: tuple[float, float, float] = (0.5, 0.0, 0.0)
    edge_m: float = 0.3
    depth_below_m: float = 0.05
    table_clearance_m: float = 0.004

    def __post_init__(self) -> None:
        require_numbers(self)
        if len(self.p_WCenter) != 3:
            raise BadInputError(f"p_WCenter is {self.p_WCenter}; expected three metres")
        for coordinate in self.p_WCenter:
            require_number("a coordinate of p_WCenter", coordinate, meaning="metres")
        if not 0.0 <= self.depth_below_m + self.table_clearance_m < self.edge_m:
            raise BadInputError(
                f"edge_m is {self.edge_m}, depth_below_m {self.depth_below_m} and "
                f"table_clearance_m {self.table_clearance_m}; expected a cube that reaches from "
                "below the table to above the clearance"
            )

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the workspace that `asdict`, and JSON after it, made these fields of."""
        return cls(**{**fields, "p_WCenter": tuple(fields["p_WCenter"])})

    @property
    def p_WV(self) -> Array:
        """The corner with the lowest coordinates, (3,) in metres."""
        half = self.edge_m / 2.0
        return np.array(self.p_WCenter) - (half, half, self.depth_below_m)

    @property
    def lowest_z_m(self) -> float:
        """The height in W up to which points count as table."""
        return self.p_WCenter[2] + self.table_clearance_m

    def contains(self, p_WPs: Array, slack_m: float = 0.0) -> NDArray[np.bool_]:
        """Return (N,): whether each of the points (N, 3) lies within the cube, above the table.

        Those that lie no further outside than `slack_m` count as well.
        """
        p_VPs = p_WPs - self.p_WV
        inside = np.all((p_VPs >= -slack_m) & (p_VPs < self.edge_m + slack_m), axis=-1)
        return inside & (p_WPs[..., 2] > self.lowest_z_m - slack_m)


def farthest_points(points: Array, count: int) -> Array:
    """Return `count` of the points (N, 3), each the farthest from those before, from the first on.

    Where N < count the sequence starts over, so that the shape stays (count, 3).
    """
    if len(points) > count:
        order = fpsample.bucket_fps_kdline_sampling(points, count, h=5, start_idx=0)
        return points[order.astype(int)]
    return points[np.arange(count) % len(points)]


@dataclass(frozen=True)
class Voxels:
    """Points gathered into the voxels that they lie in, in the order of x, then y, then z.

    Attributes:
        middles: (M, 3) mean of each voxel's points.
        counts: (M,) how many those are.
        of_point: (N,) the voxel of each point.
    """

    middles: Array
    counts: NDArray[np.intp]
    of_point: NDArray[np.intp]

    @classmethod
    def of(cls, points: Array, edge_m: float) -> Self:
        """Return the occupied voxels of points (N, 3), N >= 0."""
        cells = np.floor(np.asarray(points) / edge_m).astype(np.int64)
        order = np.lexsort(cells.T[::-1])
        differs = np.any(np.diff(cells[order], axis=0), axis=1)
        of_point = np.empty(len(cells), dtype=np.intp)
        of_point[order] = np.cumsum(np.append(False, differs))[: len(cells)]
        counts = np.bincount(of_point)
        sums = [np.bincount(of_point, weights=column) for column in np.transpose(points)]
        return cls(np.stack(sums, axis=1) / counts[:, None], counts, of_point)


def occupancy_grid(p_WPs: Array, workspace: Workspace, resolution: int) -> NDArray[np.bool_]:
    """Return (r, r, r) voxels indexed [x, y, z], true where a point lies; others are ignored."""
    indices = np.floor((p_WPs - workspace.p_WV) / workspace.edge_m * resolution).astype(int)
    indices = indices[np.all((indices >= 0) & (indices < resolution), axis=1)]
    grid = np.zeros((resolution,) * 3, dtype=bool)
    grid[tuple(indices.T)] = True
    return grid


@dataclass(frozen=True)
class Scene:
    """The workspace as seen by depth cameras.

    Attributes:
        p_WPs: (N, 3) all points seen in the workspace above the table, metres in W.
        p_WSs: (2000, 3) the sampled points that the grid is made of, metres in W.
        workspace: the cube around them.
        views: the depth views that the points come from.
    """

    p_WPs: Array
    p_WSs: Array
    workspace: Workspace
    views: tuple[DepthView, ...] = field(repr=False, default=())

    def __post_init__(self) -> None:
        for name in ("p_WPs", "p_WSs"):
            points = np.asarray(getattr(self, name))
            if points.ndim != 2 or points.shape[1] != 3 or not len(points):
                raise BadInputError(f"{name} has shape {points.shape}; expected (N, 3), N > 0")
            if not np.isfinite(points).all():
                raise BadInputError(f"{name} holds NaN or infinite values; see Scene.from_points")
        outside = int((~self.workspace.contains(self.p_WPs, _ROUNDING_M)).sum())
        if outside:
            raise BadInputError(
                f"{outside} of {len(self.p_WPs)} points p_WPs are outside of the workspace or on "
                "the table; Scene.from_points crops a cloud"
            )

    SAMPLED_POINTS = 2000
    RESOLUTION = 64

    @classmethod
    def from_views(cls, views: Sequence[DepthView], workspace: Workspace) -> "Scene":
        """Return the scene that the views show of a workspace; no noise is added.

        Raises EmptySceneError where no view shows anything in the workspace above the table.
        """
        if not views:
            raise ValueError("no depth views were given; expected at least one")
        points = np.concatenate([view.points(workspace.lowest_z_m) for view in views])
        return cls._of_points_above(points, workspace, views)

    @classmethod
    def from_points(
        cls, p_WPs: ArrayLike, workspace: Workspace, views: Sequence[DepthView] = ()
    ) -> "Scene":
        """Return the scene of a cloud of a table and what stands on it; no noise is added.

        Args:
            p_WPs: (N, 3) metres in W; rows with NaN or infinite values are points not seen.
            workspace: that the cloud is cropped to.
            views: that the cloud was made of, if there are any: some detectors need them.

        Raises BadInputError where the cloud has another shape, and EmptySceneError where none of
        its points lies in the workspace above the table.
        """
        points = np.asarray(p_WPs, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise BadInputError(f"the cloud has shape {points.shape}; expected (N, 3)")
        points = points[np.isfinite(points).all(axis=1)]
        return cls._of_points_above(points[points[:, 2] > workspace.lowest_z_m], workspace, views)

    @classmethod
    def _of_points_above(
        cls, points: Array, workspace: Workspace, views: Sequence[DepthView]
    ) -> "Scene":
        p_WPs = points[workspace.contains(points)]
        if not len(p_WPs):
            raise EmptySceneError(
                f"none of the {len(points)} points seen above the table lies in the cube of "
                f"{workspace.edge_m} m around {workspace.p_WCenter}; check units, camera poses and "
                "the workspace"
            )
        p_WSs = farthest_points(p_WPs, cls.SAMPLED_POINTS)
        return cls(p_WPs, p_WSs, workspace, tuple(views))

    def with_noise(self, noise_m: float, rng: np.random.Generator) -> "Scene":
        """Return the scene with N(0, noise_m^2) added to the sampled points (paper section V).

        The views stay as they are; see `depth_noise.with_normal_noise` for these.
        """
        require_number("noise_m", noise_m, 0.0, MAX_NOISE_M, "a standard deviation in metres")
        return replace(self, p_WSs=self.p_WSs + rng.normal(0.0, noise_m, self.p_WSs.shape))

    @cached_property
    def _grid(self) -> NDArray[np.bool_]:
        grid = occupancy_grid(self.p_WSs, self.workspace, self.RESOLUTION)
        grid.setflags(write=False)
        return grid

    def grid(self) -> NDArray[np.bool_]:
        """Return the (64, 64, 64) occupancy of the sampled points, indexed [x, y, z] from V."""
        return self._grid
