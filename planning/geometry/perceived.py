"""The object as the planner knows it: the perceived cloud, thinned and completed."""

from dataclasses import dataclass

import numpy as np

from planning.geometry.modes import modes_of
from split_drake.pose_set import PoseSets
from split_drake.pose_task import UPRIGHT
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.scene import Voxels

# Voxel edges of the cloud that the arm keeps clear of, and of the one that fingers are fitted to.
OBSTACLE_VOXEL_M = 0.009
DETAIL_VOXEL_M = 0.004

# The handle is sought within this angle of x_U when a mug's body is completed.
HANDLE_SECTOR_RAD = np.radians(45.0)
PROFILE_BIN_M = 0.008


@dataclass(frozen=True)
class PerceivedObject:
    """An object on the table.

    Attributes:
        p_WObstacles: (N, 3) coarse points on its surface, the unseen side completed where known.
        p_WDetails: (M, 3) fine points on the surface that was seen.
        p_WSurface: (L, 3) the fine points and, where known, coarse ones of the unseen side.
        p_WCom: (3,) estimated centre of mass, see `centre_of_mass`.
    """

    p_WObstacles: Array
    p_WDetails: Array
    p_WSurface: Array
    p_WCom: Array

    @classmethod
    def from_cloud(cls, p_WPs: Array, X_WU: Array | None, table_z_m: float) -> "PerceivedObject":
        """Return the object seen as a cloud (N, 3), completed around its upright pose if known.

        What lies lower than the table's top at `table_z_m` in W is no part of it.

        Raises ValueError where the cloud is empty.
        """
        if not len(p_WPs):
            raise ValueError("the perceived cloud is empty; expected points of the object")
        details = voxel_centroids(np.asarray(p_WPs, dtype=float), DETAIL_VOXEL_M)
        surface = details
        if X_WU is not None:
            unseen = revolved_body(details, X_WU)
            surface = np.concatenate([details, unseen[unseen[:, 2] > table_z_m]])
        obstacles = voxel_centroids(surface, OBSTACLE_VOXEL_M)
        return cls(obstacles, details, surface, centre_of_mass(obstacles, X_WU))


def best_upright(pose_sets: PoseSets) -> Array | None:
    """Return the best upright pose X_WU (4, 4), or None where none was detected or asked for."""
    poses = pose_sets.get(UPRIGHT.name)
    return modes_of(poses)[0].X_WP if poses is not None and len(poses) else None


def voxel_centroids(points: Array, edge_m: float) -> Array:
    """Return the mean of the points (N, 3) in every occupied voxel, (M, 3), in voxel order."""
    return Voxels.of(points, edge_m).middles


def centre_of_mass(p_WSurface: Array, X_WU: Array | None) -> Array:
    """Return the estimated centre of mass (3,) of an object whose mass is in its surface.

    Args:
        p_WSurface: (N, 3) points spread evenly over it, `OBSTACLE_VOXEL_M` apart.
        X_WU: (4, 4) its upright pose, if known.  No camera sees the base on which it stands, in U
            at z = 0; that closes it, as walls do with an outer and an inner side.
    """
    if X_WU is None:
        return np.asarray(p_WSurface.mean(axis=0))
    base = transform_points(
        X_WU, _disc(_base_radius(transform_points(invert_pose(X_WU), p_WSurface)))
    )
    return np.asarray(np.concatenate([p_WSurface, base, base]).mean(axis=0))


def _base_radius(p_UPs: Array) -> float:
    """Return the radius of the body near its base, where most of the points (N, 3) there lie."""
    low = p_UPs[p_UPs[:, 2] < p_UPs[:, 2].min() + 2.0 * PROFILE_BIN_M]
    return float(np.median(np.hypot(low[:, 0], low[:, 1])))


def _disc(radius_m: float) -> Array:
    """Return points (N, 3) of a disc around the origin, its normal z, `OBSTACLE_VOXEL_M` apart."""
    steps = np.arange(-radius_m, radius_m + 1e-9, OBSTACLE_VOXEL_M)
    x, y = (each.ravel() for each in np.meshgrid(steps, steps))
    inside = np.hypot(x, y) <= radius_m
    return np.column_stack([x, y, np.zeros_like(x)])[inside]


def revolved_body(p_WPs: Array, X_WU: Array) -> Array:
    """Return points (M, 3) of the body of revolution about z_U that the points (N, 3) lie on.

    Two views see only part of a mug; its body is round about z_U.  The handle, which is not, is
    left out: points towards x_U that lie further out than the body does elsewhere.
    """
    p_UPs = transform_points(invert_pose(X_WU), p_WPs)
    radius, height = np.hypot(p_UPs[:, 0], p_UPs[:, 1]), p_UPs[:, 2]
    in_sector = np.abs(np.arctan2(p_UPs[:, 1], p_UPs[:, 0])) < HANDLE_SECTOR_RAD
    if in_sector.all():
        return np.empty((0, 3))
    body = ~in_sector | (radius < _outer_radius(radius, height, ~in_sector))
    profile = voxel_centroids(np.column_stack([radius[body], height[body]]), OBSTACLE_VOXEL_M)
    rings = [_ring(r, z) for r, z in profile]
    return transform_points(X_WU, np.concatenate(rings))


def _outer_radius(radius: Array, height: Array, known: Array) -> Array:
    """Return (N,) the body's outer radius at each height, from the points marked `known`."""
    bins = np.floor(height / PROFILE_BIN_M).astype(int)
    outer = {b: radius[known & (bins == b)].max() for b in np.unique(bins[known])}
    fallback = max(outer.values())
    return np.array([outer.get(b, fallback) for b in bins])


def _ring(radius: float, height: float) -> Array:
    count = max(1, int(np.ceil(2.0 * np.pi * radius / OBSTACLE_VOXEL_M)))
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack(
        [radius * np.cos(angles), radius * np.sin(angles), np.full(count, height)]
    )
