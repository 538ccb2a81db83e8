"""The worker pool."""

import os
import time

import pytest

from scenarios.pool import WorkerPool


def square_or_die(item: int) -> int:
    if item == 3:
        time.sleep(0.2)
        os._exit(1)
    return item * item


def crashed(item: int) -> int:
    return -item


@pytest.mark.parametrize("workers", [1, 2])
def test_a_dead_worker_costs_only_what_it_ran(workers: int) -> None:
    results = list(WorkerPool(square_or_die, crashed, workers).run(range(6)))
    assert -3 in results
    lost = [result for result in results if result < 0]
    assert len(lost) <= workers
    assert sorted(abs(result) for result in results if result >= 0) == [
        item * item for item in range(6) if -item not in results or item == 0
    ]


def test_no_workers_is_an_error() -> None:
    with pytest.raises(ValueError, match="workers is 0"):
        WorkerPool(square_or_die, crashed, 0)
