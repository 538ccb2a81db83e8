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


class WorkerPool(Generic[Item, Result]):
    """Applies a function to items in processes, and yields results as they arrive.

    A worker that dies (a crash in native code, or killed for memory) takes down the items that run
    beside it.  They are run again one at a time, so that only an item that dies alone is given to
    `on_crash`, whatever the number of workers.
    """

    def __init__(
        self,
        function: Callable[[Item], Result],
        on_crash: Callable[[Item], Result],
        workers: int,
    ) -> None:
        if workers < 1:
            raise ValueError(f"workers is {workers}; expected at least 1")
        self._function = function
        self._on_crash = on_crash
        self._workers = workers

    def run(self, items: Sequence[Item]) -> Iterator[Result]:
        """Yield one result an item, in order of completion."""
        waiting = list(reversed(items))
        while waiting:
            suspects = yield from self._run_until_crash(waiting, self._workers)
            for suspect in suspects:
                if (yield from self._run_until_crash([suspect], workers=1)):
                    yield self._on_crash(suspect)

    def _run_until_crash(
        self, waiting: list[Item], workers: int
    ) -> Generator[Result, None, list[Item]]:
        """Take items off the end of `waiting`, yielding results, until a worker dies.

        Returns the items that were lost with it; none where no worker died.
        """
        context = multiprocessing.get_context("spawn")  # Drake and PyTorch do not survive a fork
        executor = ProcessPoolExecutor(workers, context, initializer=_end_with_parent)
        running: dict[Future[Result], Item] = {}
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    running[executor.submit(self._function, waiting[-1])] = waiting[-1]
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


def _end_with_parent() -> None:
    """End this worker once its parent has died, killed perhaps, rather than work for nobody."""
    parent = multiprocessing.parent_process()
    assert parent is not None  # this is called in workers

    def watch() -> None:
        wait_for_any([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
