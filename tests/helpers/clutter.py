"""Made-up clouds of clutter, and grasps for them."""

import numpy as np

from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array, make_pose, rotation_x, rotation_z


def box_cloud(center: tuple[float, float], edges_m: tuple[float, float, float]) -> Array:
    """Return points (N, 3), 3 mm apart, on the sides and the top of a box on the table."""
    half, height = np.array(edges_m[:2]) / 2.0, edges_m[2]
    axes = [np.arange(-h, h + 1e-9, 0.003) for h in half] + [np.arange(0.005, height, 0.003)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    beside = (np.abs(grid[:, :2]) > half - 0.004).any(axis=1)
    surface = grid[beside | (grid[:, 2] > height - 0.004)]
    return np.asarray(surface + np.array([*center, 0.0]))


def grasp_from_above(p_WG: tuple[float, float, float], yaw_rad: float = 0.0) -> Array:
    """Return X_WG (4, 4) of a hand that comes straight down and closes along y, turned by yaw."""
    return make_pose(rotation_z(yaw_rad) @ rotation_x(np.pi), p_WG)


def grasps(*X_WGs: Array) -> PoseSet:
    """Return grasps of descending scores."""
    return PoseSet(GRASP, np.stack(X_WGs), np.linspace(0.9, 0.5, len(X_WGs)))
