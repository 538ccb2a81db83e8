"""The worker pool."""

import multiprocessing
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from split_drake.experiments.pool import WorkerPool


def square_or_die(item: int) -> int:
    if item == 3:
        time.sleep(0.2)
        os._exit(1)
    return item * item


def crashed(item: int) -> int:
    return -item


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_dead_worker_costs_only_the_item_that_killed_it(workers: int) -> None:
    results = list(WorkerPool(square_or_die, workers, crashed).run(range(6)))
    assert sorted(results) == [-3, 0, 1, 4, 16, 25]


def spawn_and_stay(marks: Path) -> None:
    """Run two trials that last, and leave the workers' process numbers in a folder."""
    list(WorkerPool(mark_and_wait, workers=2).run([marks] * 2))


def mark_and_wait(marks: Path) -> str:
    (marks / str(os.getpid())).touch()
    time.sleep(60.0)
    return ""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def within(timeout_s: float, condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline and not condition():
        time.sleep(0.05)
    return condition()


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    parent = multiprocessing.get_context("spawn").Process(target=spawn_and_stay, args=(tmp_path,))
    parent.start()
    assert within(60.0, lambda: len(list(tmp_path.iterdir())) == 2)
    parent.kill()
    parent.join()
    workers = [int(mark.name) for mark in tmp_path.iterdir()]
    assert within(20.0, lambda: not any(map(alive, workers)))


def test_no_workers_is_an_error() -> None:
    with pytest.raises(ValueError, match="workers is 0"):
        WorkerPool(square_or_die, crashed, 0)
