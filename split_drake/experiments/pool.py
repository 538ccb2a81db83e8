"""Running trials in worker processes, whatever becomes of a worker."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.connection import wait as wait_for_any
from multiprocessing.process import BaseProcess
from typing import Generic, TypeVar

from split_drake.bad_input import BadInputError, require_count
from split_drake.experiments.allocator import starting_with_allocator

Item = TypeVar("Item")
Result = TypeVar("Result")


WORKER_DIED = "the worker process died"
# How often it is looked whether an item takes too long.
_POLL_S = 1.0


def too_long(limit_s: float) -> str:
    """Return what is told of an item that took longer than `limit_s`."""
    return f"it took longer than {limit_s:g} s, and its worker process was killed"


class WorkerDiedError(BadInputError, RuntimeError):
    """The processes that worked on some items died, each on its own, or took too long."""


class InThisProcess(Generic[Item, Result]):
    """Applies a function to items one after another, without another process."""

    def __init__(self, function: Callable[[Item], Result]) -> None:
        self._function = function

    def run(self, items: Sequence[Item]) -> Iterator[Result]:
        """Yield one result an item, in their order."""
        return map(self._function, items)


class WorkerPool(Generic[Item, Result]):
    """Applies a function to items in processes, and yields results as they arrive.

    A worker that dies (a crash in native code, or killed for memory) takes down the items that run
    beside it.  They are run again one at a time, so that only an item that dies alone is lost,
    whatever the number of workers.  One that takes too long is killed, and the items beside it are
    run again.  All workers are killed where the caller stops before the end, on Ctrl-C say, for
    which a worker that hangs would not stop by itself.

    Args:
        function: of an item; pickled by name.
        workers: how many processes; results must not depend on them.
        on_crash: what stands for the result of an item whose process died, or was killed, given
            the item and why.  Without it `run` raises WorkerDiedError once all other results are
            there.
        start_worker: called in each process before its first item; pickled, so that it may be a
            partial of a module's function.  What it raises, `run` raises.
        limit_s: how long an item may take, with the start of its process; choose it so generous
            that no result depends on it.  None for ever.
    """

    def __init__(
        self,
        function: Callable[[Item], Result],
        workers: int,
        on_crash: Callable[[Item, str], Result] | None = None,
        start_worker: Callable[[], None] | None = None,
        limit_s: float | None = None,
    ) -> None:
        require_count("workers", workers, 1)
        self._function = function
        self._on_crash = on_crash
        self._workers = workers
        self._start_worker = start_worker
        self._limit_s = limit_s
        self._lost: list[str] = []

    def run(self, items: Sequence[Item]) -> Iterator[Result]:
        """Yield one result an item, in order of completion."""
        waiting, self._lost = list(reversed(items)), []
        while waiting:
            suspects = yield from self._run_until_crash(waiting, self._workers)
            for suspect in suspects:
                if (yield from self._run_until_crash([suspect], workers=1)):
                    yield from self._given_up(suspect, WORKER_DIED)
        if self._lost:
            raise WorkerDiedError("; ".join(self._lost))

    def _given_up(self, item: Item, reason: str) -> Iterator[Result]:
        """Yield what stands for the result of an item, where there is such a thing."""
        if self._on_crash is None:
            self._lost.append(f"{reason} at {item}")
        else:
            yield self._on_crash(item, reason)

    def _run_until_crash(
        self, waiting: list[Item], workers: int
    ) -> Generator[Result, None, list[Item]]:
        """Take items off the end of `waiting`, yielding results, until a worker dies or is late.

        Returns the items that were lost with one that died.  Those that ran beside one that was
        late are waiting again.
        """
        context = multiprocessing.get_context("spawn")  # Drake and PyTorch do not survive a fork
        workers = min(workers, len(waiting))
        executor = ProcessPoolExecutor(workers, context, _begin_work, (self._start_worker,))
        others = set(multiprocessing.active_children())
        running: dict[Future[Result], _Started[Item]] = {}
        finished = False
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    with starting_with_allocator():
                        future = executor.submit(_work, self._function, waiting[-1])
                    running[future] = _Started(waiting.pop(), time.monotonic())
                done, _ = wait(running, self._poll_s(), return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                    del running[future]
                if late := [future for future in running if self._is_late(future, running)]:
                    _stop(executor, others)
                    found = [running.pop(future).item for future in late]
                    waiting.extend(started.item for started in reversed(running.values()))
                    for item in found:
                        yield from self._given_up(item, too_long(self._limit_s or 0.0))
                    return []
            finished = True
        except BrokenProcessPool:
            return [started.item for started in running.values()]
        finally:
            if finished:
                executor.shutdown(wait=False)
            else:
                _stop(executor, others)
        return []

    def _poll_s(self) -> float | None:
        return None if self._limit_s is None else min(_POLL_S, self._limit_s / 4.0)

    def _is_late(
        self, future: Future[Result], running: Mapping[Future[Result], "_Started[Item]"]
    ) -> bool:
        if self._limit_s is None or future.done():
            return False
        return time.monotonic() - running[future].at_s > self._limit_s


@dataclass(frozen=True)
class _Started(Generic[Item]):
    """An item, and when a worker was given it."""

    item: Item
    at_s: float


def _stop(executor: ProcessPoolExecutor, others: Collection[BaseProcess]) -> None:
    """End the executor's processes at once, whatever they are at, but none of the `others`."""
    executor.shutdown(wait=False, cancel_futures=True)
    for process in multiprocessing.active_children():
        if process not in others:
            process.kill()


# In a worker: what `start_worker` raised there, until its first item reports it.
_start_error: Exception | None = None


def _work(function: Callable[[Item], Result], item: Item) -> Result:
    """Apply a function to an item, unless this worker could not start."""
    if _start_error is not None:
        raise _start_error
    return function(item)


def _begin_work(start_worker: Callable[[], None] | None) -> None:
    """Start this worker, and end it once its parent has died, rather than work for nobody.

    An exception in here would break the pool, as a crash does: it is kept for the first item.
    """
    global _start_error
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which ends this process
    parent = multiprocessing.parent_process()
    assert parent is not None  # this is called in workers

    def watch() -> None:
        wait_for_any([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if start_worker is not None:
        try:
            start_worker()
        except Exception as error:
            _start_error = error
