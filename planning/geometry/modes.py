"""Modes of a pose set: poses that lie close together, those that mean the same taken for one."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from split_drake.pose_set import PoseSet
from split_drake.pose_task import Symmetry
from split_drake.poses import Array, make_pose, rotation_error_rad

# Poses closer together than this, in both place and rotation, are one mode of a pose set.
MODE_DISTANCE_M = 0.01
MODE_ANGLE_RAD = np.radians(15.0)
# A mode with less than this share of all poses is a fluke, unless its best pose has this share of
# the best score: of 253 upright poses, one may stand a mug on its rim.
LEAST_SHARE, NEARLY_BEST = 0.02, 0.9
# Poses closer than this to one that failed are taken to fail as well.
FAILURE_DISTANCE_M = 0.015
FAILURE_ANGLE_RAD = np.radians(25.0)


def distinct_modes(X_WPs: Array, count: int, symmetry: Symmetry) -> list[int]:
    """Return indices of at most `count` poses (N, 4, 4), best first, no two of one mode."""
    chosen: list[int] = []
    for index, X in enumerate(X_WPs):
        if len(chosen) == count:
            break
        if not _same_mode(symmetry.nearest(X_WPs[chosen], X), X).any():
            chosen.append(index)
    return chosen


def mode_means(pose_set: PoseSet, count: int) -> list[tuple[Array, float]]:
    """Return at most `count` modes as (mean pose (4, 4), best score), best first, without flukes.

    Samples scatter around what was detected; their mean, weighted by score, scatters less.
    """
    means, symmetry = [], pose_set.task.symmetry
    for index in distinct_modes(pose_set.X_WPs, count, symmetry):
        X_WBest = pose_set.X_WPs[index]
        X_WPs = symmetry.nearest(pose_set.X_WPs, X_WBest)
        members = _same_mode(X_WPs, X_WBest)
        nearly_best = pose_set.scores[index] >= NEARLY_BEST * pose_set.scores[0]
        if members.mean() < LEAST_SHARE and not nearly_best:
            continue
        weights = pose_set.scores[members] + 1e-9
        R_WP = Rotation.from_matrix(X_WPs[members, :3, :3]).mean(weights).as_matrix()
        p_WP = np.average(X_WPs[members, :3, 3], axis=0, weights=weights)
        means.append((make_pose(R_WP, p_WP), float(pose_set.scores[index])))
    return means


def away_from(X_WPs: Array, X_WFs: Array, symmetry: Symmetry) -> NDArray[np.bool_]:
    """Return (N,): which of the poses (N, 4, 4) are unlike all that failed, X_WFs (F, 4, 4)."""
    away = np.ones(len(X_WPs), dtype=bool)
    for X_WF in X_WFs:
        away &= ~_close(symmetry.nearest(X_WPs, X_WF), X_WF, FAILURE_DISTANCE_M, FAILURE_ANGLE_RAD)
    return away


def _same_mode(X_WPs: Array, X_WP: Array) -> NDArray[np.bool_]:
    """Return (N,): which poses (N, 4, 4) are of the mode of a pose (4, 4)."""
    return _close(X_WPs, X_WP, MODE_DISTANCE_M, MODE_ANGLE_RAD)


def _close(X_WPs: Array, X_WP: Array, distance_m: float, angle_rad: float) -> NDArray[np.bool_]:
    distances = np.linalg.norm(X_WPs[:, :3, 3] - X_WP[:3, 3], axis=1)
    angles = rotation_error_rad(X_WPs[:, :3, :3], X_WP[:3, :3])
    return np.asarray((distances < distance_m) & (angles < angle_rad))
