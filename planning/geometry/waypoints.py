"""Pose algebra of a pick and place: pure functions of grasps, goals and the hook.

Frames as in `split_drake`; a trailing name marks a moment, as in X_WGhang = X_WHgoal X_HG.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from split_drake.pose_task import GRASP
from split_drake.poses import Array, make_pose

APPROACH_M = 0.08
LINE_STEP_M = 0.01


def with_half_turns(X_WGs: ArrayLike) -> Array:
    """Return (2N, 4, 4): every grasp, then every grasp turned by Rot_z(pi)."""
    grasps = np.asarray(X_WGs, dtype=float)
    return np.concatenate([grasps, grasps @ GRASP.symmetry.X_half_turn])


def place_grasp(X_WOgoal: ArrayLike, X_WO: ArrayLike, X_WG: ArrayLike) -> Array:
    """Return X_WGgoal (..., 4, 4) that brings frame O of a held object from X_WO to X_WOgoal.

    X_WGgoal = X_WOgoal X_OG with X_OG = X_WO^-1 X_WG; the arguments' batches broadcast.
    """
    X_OG = np.linalg.solve(np.asarray(X_WO, dtype=float), np.asarray(X_WG, dtype=float))
    return np.asarray(X_WOgoal, dtype=float) @ X_OG


def shifted(X_WG: ArrayLike, p_W: ArrayLike) -> Array:
    """Return the pose (..., 4, 4) moved by `p_W` (3,), given in W."""
    X = np.array(X_WG, dtype=float)
    X[..., :3, 3] += np.asarray(p_W, dtype=float)
    return X


def backed_off(X_WG: ArrayLike, distance_m: float) -> Array:
    """Return the pose (..., 4, 4) moved back along its approach direction z_G."""
    X = np.array(X_WG, dtype=float)
    X[..., :3, 3] -= distance_m * X[..., :3, 2]
    return X


def straight_line(X_WA: ArrayLike, X_WB: ArrayLike, step_m: float) -> Array:
    """Return (N, 4, 4) poses from after A up to B, N = ceil(distance / step), rotation of B.

    Raises ValueError where the rotations differ: a straight line does not turn.
    """
    start, end = np.asarray(X_WA, dtype=float), np.asarray(X_WB, dtype=float)
    if np.abs(start[:3, :3] - end[:3, :3]).max() > 1e-6:
        raise ValueError("the rotations at the ends of a straight line differ; expected equal ones")
    travel = end[:3, 3] - start[:3, 3]
    count = max(1, int(np.ceil(np.linalg.norm(travel) / step_m - 1e-9)))
    shares = np.arange(1, count + 1) / count
    return make_pose(end[:3, :3], start[:3, 3] + shares[:, None] * travel)


def polyline(X_WGs: Sequence[ArrayLike], step_m: float) -> Array:
    """Return (N, 4, 4) poses along straight lines through all of `X_WGs`, the first included."""
    corners = [np.asarray(X, dtype=float) for X in X_WGs]
    lines = [straight_line(a, b, step_m) for a, b in pairwise(corners)]
    return np.concatenate([corners[0][None], *lines])
