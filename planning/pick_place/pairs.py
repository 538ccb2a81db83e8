"""Pairs of a grasp and a placement, best first, drawn lazily."""

import heapq
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike


class BestPairs:
    """Pairs (row, column) in descending order of the product of their scores.

    A row found useless is dropped as a whole.  Ties go to the earlier row, then to the column of
    the better score, then to the earlier one.
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
