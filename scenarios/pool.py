"""Running trials in worker processes, whatever becomes of a worker."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class WorkerPool(Generic[Item, Result]):
    """Applies a function to items in processes, and yields results as they arrive.

    A worker that dies (a crash in native code, or killed for memory) costs the items that were
    running, no others: they are given to `on_crash`, and the pool starts anew.
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
            yield from self._run_until_crash(waiting)

    def _run_until_crash(self, waiting: list[Item]) -> Iterator[Result]:
        """Take items off the end of `waiting`; return when it is empty or a worker died."""
        context = multiprocessing.get_context("spawn")  # Drake and PyTorch do not survive a fork
        executor = ProcessPoolExecutor(self._workers, mp_context=context)
        running: dict[Future[Result], Item] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self._workers:
                    item = waiting.pop()
                    running[executor.submit(self._function, item)] = item
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                if any(isinstance(future.exception(), BrokenProcessPool) for future in done):
                    yield from self._collect_after_crash(running)
                    return
                for future in done:
                    del running[future]
                    yield future.result()
        finally:
            executor.shutdown(wait=False, cancel_futures=True)

    def _collect_after_crash(self, running: dict[Future[Result], Item]) -> Iterator[Result]:
        for future, item in running.items():
            if isinstance(future.exception(), BrokenProcessPool):
                yield self._on_crash(item)
            else:
                yield future.result()
