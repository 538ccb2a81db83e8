"""The worker pool."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path

import pytest

from split_drake.experiments.pool import InThisProcess, WorkerDiedError, WorkerPool


def square_or_die(item: int) -> int:
    if item == 3:
        time.sleep(0.2)
        os._exit(1)
    return item * item


def crashed(item: int, reason: str) -> int:
    assert reason == "the worker process died"
    return -item


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_dead_worker_costs_only_the_item_that_killed_it(workers: int) -> None:
    results = list(WorkerPool(square_or_die, workers, crashed).run(range(6)))
    assert sorted(results) == [-3, 0, 1, 4, 16, 25]


def test_without_a_stand_in_the_lost_items_are_named_after_all_other_results() -> None:
    arrived = []
    with pytest.raises(WorkerDiedError, match=r"died at 3$"):
        for result in WorkerPool(square_or_die, workers=2).run(range(6)):
            arrived.append(result)
    assert sorted(arrived) == [0, 1, 4, 16, 25]


def mark_start(marks: Path) -> None:
    with (marks / str(os.getpid())).open("a") as file:
        file.write("started ")


def starts_before(marks: Path) -> str:
    return (marks / str(os.getpid())).read_text()


def test_each_worker_is_started_once_before_its_items(tmp_path: Path) -> None:
    pool = WorkerPool(starts_before, workers=2, start_worker=partial(mark_start, tmp_path))
    assert list(pool.run([tmp_path] * 8)) == ["started "] * 8
    marks = [mark.read_text() for mark in tmp_path.iterdir()]
    assert 1 <= len(marks) <= 2
    assert set(marks) == {"started "}


def process_of(item: int) -> tuple[int, int]:
    return item, os.getpid()


def test_a_pool_in_this_process_takes_items_in_turn_and_starts_no_other() -> None:
    assert list(InThisProcess(process_of).run([3, 1, 2])) == [(n, os.getpid()) for n in (3, 1, 2)]


def test_a_pool_in_this_process_works_on_an_item_when_it_is_asked_for() -> None:
    asked: list[int] = []
    results = InThisProcess(asked.append).run(range(6))
    assert len(list(islice(results, 2))) == 2
    assert asked == [0, 1]


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
        WorkerPool(square_or_die, 0, crashed)


def fail_to_start(marks: Path) -> None:
    mark_start(marks)
    raise ValueError("my detector's weights are missing")


def test_what_keeps_workers_from_starting_is_raised_at_once(tmp_path: Path) -> None:
    pool = WorkerPool(square_or_die, 2, crashed, start_worker=partial(fail_to_start, tmp_path))
    with pytest.raises(ValueError, match="my detector's weights are missing"):
        list(pool.run(range(20)))
    assert len(list(tmp_path.iterdir())) <= 2


def square_or_hang(item: int) -> int:
    while item == 2:
        time.sleep(60.0)
    return item * item


def told(item: int, reason: str) -> str:
    return f"{item}: {reason}"


@pytest.mark.parametrize("workers", [1, 2])
def test_an_item_that_takes_too_long_is_ended_and_costs_no_other(workers: int) -> None:
    pool = WorkerPool[int, int | str](square_or_hang, workers, told, limit_s=15.0)
    found = list(pool.run(range(5)))
    assert [each for each in found if isinstance(each, str)] == [
        "2: it took longer than 15 s, and its worker process was killed"
    ]
    assert sorted(each for each in found if isinstance(each, int)) == [0, 1, 9, 16]


def test_without_a_stand_in_items_that_took_too_long_are_named() -> None:
    with pytest.raises(WorkerDiedError, match=r"longer than 5 s, and its .* was killed at 2$"):
        list(WorkerPool(square_or_hang, 1, limit_s=5.0).run([2]))


RUN_UNTIL_INTERRUPTED = """
import signal, sys
from pathlib import Path
from split_drake.experiments.pool import WorkerPool
from tests.split_drake.experiments.test_pool import mark_and_hang
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells' background jobs ignore it
    try:
        list(WorkerPool(mark_and_hang, workers=2).run([Path(sys.argv[1])] * 2))
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


def mark_and_hang(marks: Path) -> str:
    """Leave the process number, and never end."""
    (marks / str(os.getpid())).touch()
    while True:
        time.sleep(60.0)


def test_ctrl_c_does_not_wait_for_workers_that_hang(tmp_path: Path) -> None:
    command = [sys.executable, "-c", RUN_UNTIL_INTERRUPTED, str(tmp_path)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert within(60.0, lambda: len(list(tmp_path.iterdir())) == 2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, the workers too
    shown, errors = process.communicate(timeout=30.0)
    assert (shown, errors, process.returncode) == ("interrupted\n", "", 0)
    workers = [int(mark.name) for mark in tmp_path.iterdir()]
    assert within(10.0, lambda: not any(map(alive, workers)))
