"""Which detected poses are good, each compared with the truth of its scene.

A pose is good within 1 cm and 15 degrees of a true one.  A grasp is good where it would hold the
object geometrically and the hand reaches it without hitting object or table.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from split_drake.grasps.judge import GraspJudge, feasible
from split_drake.pose_task import GRASP, Symmetry
from split_drake.poses import Array, invert_pose

GOOD_POSITION_M = 0.01
GOOD_ROTATION_RAD = np.radians(15.0)

# A true grasp is covered by one within this distance and angle.
NEAR_POSITION_M = 0.02
NEAR_ROTATION_RAD = np.radians(20.0)

# The signs of a flat R (9,), and those of the R of the same grasp after its half turn.
_TURNS = (np.ones(9), np.tile(np.diag(GRASP.symmetry.X_half_turn)[:3], 3))


@dataclass(frozen=True)
class Judgement:
    """How poses (N) compare with true ones.

    Attributes:
        good: (N,) whether each is.
        nearest: (N,) number of the nearest true pose, 0 to M - 1.
        position_m, rotation_rad: (N,) errors to the nearest true pose.
    """

    good: NDArray[np.bool_]
    nearest: NDArray[np.int_]
    position_m: Array
    rotation_rad: Array


@dataclass(frozen=True)
class GraspJudgement:
    """What geometry says of grasps (N), as the object lies.

    Attributes:
        good: (N,) whether each is reachable and holds.
        reachable: (N,) whether the opened hand comes in from above and hits nothing.
        openings_m: (N,) that it comes in with.
    """

    good: NDArray[np.bool_]
    reachable: NDArray[np.bool_]
    openings_m: Array


def judge_poses(X_WPs: Array, X_WTruths: Array, symmetry: Symmetry) -> Judgement:
    """Compare poses (N, 4, 4) with true poses (M, 4, 4), each with the nearest.

    Poses that mean the same by the symmetry count as one.
    """
    position = np.linalg.norm(X_WPs[:, None, :3, 3] - X_WTruths[None, :, :3, 3], axis=-1)
    rotation = symmetry.rotation_error_rad(X_WPs[:, None, :3, :3], X_WTruths[None, :, :3, :3])
    good = (position < GOOD_POSITION_M) & (rotation < GOOD_ROTATION_RAD)
    nearest = np.argmin(position / GOOD_POSITION_M + rotation / GOOD_ROTATION_RAD, axis=1)
    rows = np.arange(len(X_WPs))
    errors = position[rows, nearest], rotation[rows, nearest]
    return Judgement(good.any(axis=1), nearest, *errors)


def judge_grasps(X_WGs: Array, judge: GraspJudge, X_WO: Array, table_z_m: float) -> GraspJudgement:
    """Check grasps (N, 4, 4) of the object of `judge`, at X_WO, geometrically.

    The table's top is at `table_z_m` in W.
    """
    X_OGs = invert_pose(X_WO) @ X_WGs
    check = judge.check(X_OGs)
    clears = feasible(X_WO, X_OGs, check.openings_m, table_z_m)
    return GraspJudgement(check.good & clears, ~check.collides & clears, check.openings_m)


def direction_error_rad(d_As: Array, d_Bs: Array) -> Array:
    """Return the angles in [0, pi] between unit vectors (..., 3); shapes broadcast."""
    cosine = np.einsum("...i,...i->...", d_As, d_Bs)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def line_error_rad(d_As: Array, d_Bs: Array) -> Array:
    """Return the angles in [0, pi/2] between lines along unit vectors (..., 3)."""
    error = direction_error_rad(d_As, d_Bs)
    return np.minimum(error, np.pi - error)


def yaw_error_rad(R_WA: Array, R_WB: Array) -> Array:
    """Return the angles in [0, pi] by which rotations (..., 3, 3) differ about their own z.

    It is the twist of R_AB = swing * twist: what is left once the shortest rotation has aligned the
    z axes, so that it says nothing of how far those are apart.
    """
    R_AB = np.swapaxes(R_WA, -1, -2) @ R_WB
    sine = R_AB[..., 1, 0] - R_AB[..., 0, 1]
    cosine = R_AB[..., 0, 0] + R_AB[..., 1, 1]
    return np.asarray(np.abs(np.arctan2(sine, cosine)))


def covered(X_WTruths: Array, X_WGs: Array) -> NDArray[np.bool_]:
    """Return (M,): whether one of the grasps (N, 4, 4) lies near each true one (M, 4, 4).

    Near means within 2 cm and 20 degrees, a grasp's half turn counted as nothing.
    """
    if not len(X_WTruths) or not len(X_WGs):
        return np.zeros(len(X_WTruths), dtype=bool)
    near = cdist(X_WTruths[:, :3, 3], X_WGs[:, :3, 3]) <= NEAR_POSITION_M
    R_truths, R_found = (X[:, :3, :3].reshape(-1, 9) for X in (X_WTruths, X_WGs))
    traces = [(R_truths * turn) @ R_found.T for turn in _TURNS]
    aligned = np.maximum(*traces) >= 1.0 + 2.0 * np.cos(NEAR_ROTATION_RAD)
    return np.any(near & aligned, axis=1)
