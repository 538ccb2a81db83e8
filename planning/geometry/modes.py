"""Modes of a pose set: poses that lie close together, those that mean the same taken for one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from split_drake.pose_set import PoseSet
from split_drake.pose_task import Symmetry
from split_drake.poses import Array, make_pose, rotation_error_rad

# Poses closer together than this, in both place and rotation, are one mode of a pose set.
MODE_DISTANCE_M = 0.01
MODE_ANGLE_RAD = np.radians(15.0)
# A mode with less than this share of all poses is a fluke where a larger one has nearly its score:
# of 253 upright poses, one may stand a mug on its rim.
LEAST_SHARE, NEARLY = 0.02, 0.9
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


@dataclass(frozen=True)
class Mode:
    """Poses that mean nearly the same as one of them.

    Attributes:
        X_WP: (4, 4) that one.
        score: of it.
        X_WPs: (M, 4, 4) all of them, each as it lies nearest to that one.
        scores: (M,) of all.
    """

    X_WP: Array
    score: float
    X_WPs: Array
    scores: Array

    def mean(self) -> Array:
        """Return the mean pose (4, 4), weighted by score.

        Samples scatter around what was detected; their mean scatters less.
        """
        weights = self.scores + 1e-9
        R_WP = Rotation.from_matrix(self.X_WPs[:, :3, :3]).mean(weights).as_matrix()
        return make_pose(R_WP, np.average(self.X_WPs[:, :3, 3], axis=0, weights=weights))


def modes_of(pose_set: PoseSet) -> list[Mode]:
    """Return the modes of a pose set, best first, without flukes."""
    symmetry, found = pose_set.task.symmetry, []
    for index in distinct_modes(pose_set.X_WPs, len(pose_set), symmetry):
        X_WP = pose_set.X_WPs[index]
        X_WPs = symmetry.nearest(pose_set.X_WPs, X_WP)
        members = _same_mode(X_WPs, X_WP)
        score = float(pose_set.scores[index])
        found.append(Mode(X_WP, score, X_WPs[members], pose_set.scores[members]))
    least = LEAST_SHARE * len(pose_set)
    large = max((mode.score for mode in found if len(mode.scores) >= least), default=0.0)
    return [mode for mode in found if len(mode.scores) >= least or large <= NEARLY * mode.score]


def mode_means(pose_set: PoseSet, count: int) -> list[tuple[Array, float]]:
    """Return at most `count` modes as (mean pose (4, 4), best score), best first."""
    return [(mode.mean(), mode.score) for mode in modes_of(pose_set)[:count]]


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
