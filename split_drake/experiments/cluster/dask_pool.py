"""A pool whose workers are Dask's, on any machines."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar
from uuid import uuid4

from distributed import Client, Future
from distributed.client import FutureCancelledError
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker

from split_drake.bad_input import BadInputError
from split_drake.experiments.cluster.address import (
    address_of,
    connect,
    warn_if_open,
)
from split_drake.experiments.cluster.lane import Answer
from split_drake.experiments.cluster.plugin import (
    Code,
    OtherWorkerError,
    RunPlugin,
    UnpreparedWorkerError,
    apply_on_worker,
    processor_of_worker,
)
from split_drake.experiments.cluster.travel import Freight, pack, unpack, write_files
from split_drake.experiments.pool import WORKER_DIED, WorkerDiedError, too_long
from split_drake.experiments.provenance import processor

Item = TypeVar("Item")
Result = TypeVar("Result")

# How long a scheduler may take to answer at first, and to come back once it was there.
FIRST_S, PATIENCE_S = 30.0, 600.0
# How often it is looked whether the scheduler is still there.
_POLL_S = 0.5
# Workers that may die under an item, beside those that Dask itself tries; items run in processes
# beside the worker, so that it is hardly the item's doing.
_DEATHS = 3


class _SchedulerLostError(Exception):
    """The scheduler went away, with all that it knew."""


class DaskPool(Generic[Item, Result]):
    """Applies a function to items on the workers of a scheduler, as `WorkerPool` does here.

    Files that the function or the items name go to the workers; what items write into the run's
    folder comes back before their results.  Workers that come are used, items of workers that go
    are run elsewhere.  Where the scheduler goes, and comes back within ten minutes, the run goes on
    with what is missing.

    Args:
        scheduler: see `address_of`.
        function, on_crash, start_worker, limit_s: see `WorkerPool`.
        run: folder that items write into, and name paths of; None where they write nothing.
        kept: entries of it that items read, too, such as a cache.
        patience_s: how long a scheduler that went away may take to come back.
    """

    def __init__(
        self,
        scheduler: str,
        function: Callable[[Item], Result],
        on_crash: Callable[[Item, str], Result] | None = None,
        start_worker: Callable[[], None] | None = None,
        limit_s: float | None = None,
        run: Path | None = None,
        kept: Sequence[str] = (),
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._address = address_of(scheduler)
        self._function = (function, start_worker)
        self._on_crash = on_crash
        self._limit_s = limit_s
        self._run, self._kept = run, tuple(kept)
        self._patience_s = patience_s
        self._lost: list[str] = []

    def run(self, items: Sequence[Item]) -> Iterator[Result]:
        """Yield one result an item, in order of completion.

        Raises NoSchedulerError where none answers, and BadInputError where a worker has other code.
        """
        if not items:
            return
        self._lost = []
        warn_if_open(self._address)
        freight = Freight()
        packed = [pack(item, self._run, freight) for item in items]
        plugin = self._plugin(freight)
        waiting = dict(enumerate(items))
        patience_s = FIRST_S
        while waiting:
            client = connect(self._address, patience_s)
            try:
                yield from self._run_on(client, plugin, waiting, packed)
            except _SchedulerLostError:
                _say(f"the scheduler at {self._address} went away; waiting for it to come back")
                patience_s = self._patience_s
            finally:
                _close(client, plugin.name)
        if self._lost:
            raise WorkerDiedError("; ".join(self._lost))

    def _plugin(self, freight: Freight) -> RunPlugin:
        function = pack(self._function, self._run, freight)
        return RunPlugin(
            f"split-{uuid4().hex}",
            function,
            freight.contents(),
            self._kept,
            _contents(self._run, self._kept),
            self._limit_s,
            WORKER_DIED,
            too_long(self._limit_s or 0.0),
            Code.here(),
        )

    def _run_on(
        self,
        client: Client,
        plugin: RunPlugin,
        waiting: dict[int, Item],
        packed: Sequence[bytes],
    ) -> Iterator[Result]:
        """Yield results, taking their items out of `waiting`, until all are there."""
        done: SimpleQueue[tuple[int, Future]] = SimpleQueue()
        deaths: Counter[int] = Counter()
        futures: dict[int, Future] = {}

        def submit(number: int) -> None:
            key = f"{plugin.name}-{number}-{deaths[number]}-{uuid4().hex[:8]}"
            future = client.submit(
                apply_on_worker, plugin.name, packed[number], key=key, pure=False
            )
            futures[number] = future
            future.add_done_callback(lambda ended: done.put((number, ended)))

        _prepare(client, plugin)
        for number in waiting:
            submit(number)
        while waiting:
            try:
                number, future = done.get(timeout=_POLL_S)
            except Empty:
                if client.status != "running":
                    raise _SchedulerLostError from None
                continue
            if number not in waiting or futures[number] is not future:
                continue
            answer = self._answer(client, plugin, future, deaths, number)
            if answer is None:
                submit(number)
            else:
                del futures[number]
                yield from self._results(answer, waiting.pop(number))

    def _answer(
        self,
        client: Client,
        plugin: RunPlugin,
        future: Future,
        deaths: Counter[int],
        number: int,
    ) -> Answer | None:
        """Return an item's answer; None where it is to be tried again."""
        try:
            return future.result()
        except KilledWorker:
            deaths[number] += 1
            return None if deaths[number] <= _DEATHS else Answer(lost=WORKER_DIED)
        except UnpreparedWorkerError:
            _prepare(client, plugin)
            return None
        except OtherWorkerError as error:
            raise BadInputError(f"{error}; a run needs the same on all its workers") from error
        except (CancelledError, FutureCancelledError, CommClosedError, TimeoutError) as error:
            if client.status != "running":
                raise _SchedulerLostError from error
            return None

    def _results(self, answer: Answer, item: Item) -> Iterator[Result]:
        if answer.error is not None:
            raise answer.error
        if answer.files and self._run is not None:
            write_files(self._run, answer.files)
        if not answer.lost:
            yield unpack(answer.result, self._run)
        elif self._on_crash is None:
            self._lost.append(f"{answer.lost} at {item}")
        else:
            yield self._on_crash(item, answer.lost)


def _contents(run: Path | None, kept: Sequence[str]) -> dict[str, bytes]:
    """Return {place: content} of those entries of the run's folder that are there."""
    if run is None:
        return {}
    entries = [run / name for name in kept]
    files = [path for entry in entries for path in (entry, *entry.rglob("*")) if path.is_file()]
    return {str(path.relative_to(run)): path.read_bytes() for path in files}


def _prepare(client: Client, plugin: RunPlugin) -> None:
    """Prepare all workers for the run, and say which there are."""
    try:
        client.register_plugin(plugin)
        _tell_workers(client.run(processor_of_worker))
    except (CommClosedError, OSError, TimeoutError) as error:
        raise _SchedulerLostError from error
    except ImportError as error:
        raise BadInputError(
            f"a worker cannot import {error.name}; expected this project to be installed there"
        ) from error


def _tell_workers(processors: Mapping[str, str]) -> None:
    counts = Counter(processors.values())
    if not counts:
        _say("the scheduler has no worker yet; waiting for some")
        return
    _say("workers: " + ", ".join(f"{count} on {name}" for name, count in counts.items()))
    if others := sorted(set(counts) - {processor()}):
        _say(f"some outcomes may differ from those on {processor()}, on {', '.join(others)}")


def _close(client: Client, name: str) -> None:
    """Leave the scheduler, ending what its workers are still at."""
    try:
        if client.status == "running":
            client.unregister_worker_plugin(name)
    except (KeyError, ValueError, OSError, TimeoutError, CancelledError):
        pass  # it is gone, or never knew of the run
    client.close(timeout=5.0)


def _say(text: str) -> None:
    print(text, file=sys.stderr)
