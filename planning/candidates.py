"""Pairs of a grasp and a placement, best first, drawn lazily."""

import heapq
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from split_drake.pose_set import PoseSet
from split_drake.poses import Array, make_pose, rotation_error_rad

# Poses closer together than this, in both place and rotation, are one mode of a pose set.
MODE_DISTANCE_M = 0.01
MODE_ANGLE_RAD = np.radians(15.0)


class BestPairs:
    """Pairs (row, column) in descending order of the product of their scores.

    A row found useless is dropped as a whole; ties go to the earlier row, then column.
    """

    def __init__(self, row_scores: ArrayLike, column_scores: ArrayLike) -> None:
        self._rows = np.asarray(row_scores, dtype=float)
        self._columns = np.asarray(column_scores, dtype=float)
        self._column_order = np.argsort(-self._columns, kind="stable")
        self._dropped: set[int] = set()

    def drop_row(self, row: int) -> None:
        """Leave out the pairs of this row from now on."""
        self._dropped.add(row)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        if not len(self._columns):
            return
        heap = [self._entry(row, 0) for row in range(len(self._rows))]
        heapq.heapify(heap)
        while heap:
            _, row, rank = heapq.heappop(heap)
            if row in self._dropped:
                continue
            yield row, int(self._column_order[rank])
            if rank + 1 < len(self._columns):
                heapq.heappush(heap, self._entry(row, rank + 1))

    def _entry(self, row: int, rank: int) -> tuple[float, int, int]:
        score = self._rows[row] * self._columns[self._column_order[rank]]
        return (-float(score), row, rank)


def distinct_modes(X_WPs: Array, count: int) -> list[int]:
    """Return indices of at most `count` poses (N, 4, 4), best first, no two of one mode."""
    chosen: list[int] = []
    for index, X in enumerate(X_WPs):
        if not _same_mode(X_WPs[chosen], X).any():
            chosen.append(index)
        if len(chosen) == count:
            break
    return chosen


def mode_means(pose_set: PoseSet, count: int) -> list[tuple[Array, float]]:
    """Return at most `count` modes as (mean pose (4, 4), best score), best first.

    Samples scatter around what was detected; their mean, weighted by score, scatters less.
    """
    means = []
    for index in distinct_modes(pose_set.X_WPs, count):
        members = _same_mode(pose_set.X_WPs, pose_set.X_WPs[index])
        weights = pose_set.scores[members] + 1e-9
        poses = pose_set.X_WPs[members]
        R_WP = Rotation.from_matrix(poses[:, :3, :3]).mean(weights).as_matrix()
        p_WP = np.average(poses[:, :3, 3], axis=0, weights=weights)
        means.append((make_pose(R_WP, p_WP), float(pose_set.scores[index])))
    return means


def _same_mode(X_WPs: Array, X_WP: Array) -> NDArray[np.bool_]:
    """Return (N,): which poses (N, 4, 4) are of the mode of a pose (4, 4)."""
    distances = np.linalg.norm(X_WPs[:, :3, 3] - X_WP[:3, 3], axis=1)
    angles = rotation_error_rad(X_WPs[:, :3, :3], X_WP[:3, :3])
    return np.asarray((distances < MODE_DISTANCE_M) & (angles < MODE_ANGLE_RAD))
