"""Running trials in worker processes, whatever becomes of a worker."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for_any
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkerDiedError(RuntimeError):
    """The processes that worked on some items died, each on its own."""


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
    whatever the number of workers.

    Args:
        function: of an item; pickled by name.
        workers: how many processes; results must not depend on them.
        on_crash: what stands for the result of an item whose process died.  Without it `run` raises
            WorkerDiedError once all other results are there.
        start_worker: called in each process before its first item; pickled, so that it may be a
            partial of a module's function.  What it raises, `run` raises.
    """

    def __init__(
        self,
        function: Callable[[Item], Result],
        workers: int,
        on_crash: Callable[[Item], Result] | None = None,
        start_worker: Callable[[], None] | None = None,
    ) -> None:
        if workers < 1:
            raise ValueError(f"workers is {workers}; expected at least 1")
        self._function = function
        self._on_crash = on_crash
        self._workers = workers
        self._start_worker = start_worker

    def run(self, items: Sequence[Item]) -> Iterator[Result]:
        """Yield one result an item, in order of completion."""
        waiting, lost = list(reversed(items)), list[Item]()
        while waiting:
            suspects = yield from self._run_until_crash(waiting, self._workers)
            for suspect in suspects:
                if (yield from self._run_until_crash([suspect], workers=1)):
                    if self._on_crash is None:
                        lost.append(suspect)
                    else:
                        yield self._on_crash(suspect)
        if lost:
            raise WorkerDiedError(f"the worker process died at {', '.join(map(str, lost))}")

    def _run_until_crash(
        self, waiting: list[Item], workers: int
    ) -> Generator[Result, None, list[Item]]:
        """Take items off the end of `waiting`, yielding results, until a worker dies.

        Returns the items that were lost with it; none where no worker died.
        """
        context = multiprocessing.get_context("spawn")  # Drake and PyTorch do not survive a fork
        workers = min(workers, len(waiting))
        executor = ProcessPoolExecutor(workers, context, _begin_work, (self._start_worker,))
        running: dict[Future[Result], Item] = {}
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    running[executor.submit(_work, self._function, waiting[-1])] = waiting[-1]
                    waiting.pop()
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
                    del running[future]
        except BrokenProcessPool:
            return list(running.values())
        finally:
            executor.shutdown(wait=False, cancel_futures=True)
        return []


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
