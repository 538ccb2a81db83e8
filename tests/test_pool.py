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


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_dead_worker_costs_only_the_item_that_killed_it(workers: int) -> None:
    results = list(WorkerPool(square_or_die, crashed, workers).run(range(6)))
    assert sorted(results) == [-3, 0, 1, 4, 16, 25]


def test_no_workers_is_an_error() -> None:
    with pytest.raises(ValueError, match="workers is 0"):
        WorkerPool(square_or_die, crashed, 0)
