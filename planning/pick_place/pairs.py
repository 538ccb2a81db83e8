"""Pairs of a grasp and a placement, best first, drawn lazily."""

import heapq
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

# In place of a column's rank: of the row no more than a bound is known.
_BOUNDED = -1


class BestPairs:
    """Pairs (row, column) in descending order of the product of their scores.

    A row found useless is dropped as a whole.  Ties go to the earlier row, then to the column of
    the better score, then to the earlier one.

    Args:
        row_scores: (R,) scores of the rows; or bounds of them, where `exact` is given.
        column_scores: (C,) scores of the columns.
        exact: what a row's score is, which is no more than its bound.  It is asked for no earlier
            than its turn may have come, and once an iteration: a score may take long to find out.
    """

    def __init__(
        self,
        row_scores: ArrayLike,
        column_scores: ArrayLike,
        exact: Callable[[int], float] | None = None,
    ) -> None:
        self._rows = np.array(row_scores, dtype=float)
        self._exact = exact
        self._columns = np.asarray(column_scores, dtype=float)
        self._column_order = np.argsort(-self._columns, kind="stable")
        self._dropped: set[int] = set()

    def drop_row(self, row: int) -> None:
        """Leave out the pairs of this row from now on."""
        self._dropped.add(row)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        if not len(self._columns):
            return
        first = 0 if self._exact is None else _BOUNDED
        heap = [self._entry(row, first) for row in range(len(self._rows))]
        heapq.heapify(heap)
        while heap:
            _, row, rank = heapq.heappop(heap)
            if row in self._dropped:
                continue
            if rank == _BOUNDED and self._exact is not None:
                self._rows[row] = self._exact(row)
            else:
                yield row, int(self._column_order[rank])
            if rank + 1 < len(self._columns):
                heapq.heappush(heap, self._entry(row, rank + 1))

    def _entry(self, row: int, rank: int) -> tuple[float, int, int]:
        score = self._rows[row] * self._columns[self._column_order[max(rank, 0)]]
        return (-float(score), row, rank)
