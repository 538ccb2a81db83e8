"""A pool whose workers are Dask's, on any machines."""

import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar
from uuid import uuid4

from distributed import Client, Future
from distributed.client import ClosedClientError, FutureCancelledError
from distributed.comm import CommClosedError
from distributed.scheduler import KilledWorker

from split_drake.bad_input import BadInputError
from split_drake.experiments.cluster.address import address_of, connect, warn_if_open
from split_drake.experiments.cluster.lane_program import Answer
from split_drake.experiments.cluster.plugin import (
    BrokenWorkerError,
    Code,
    OtherWorkerError,
    RunPlugin,
    UnpreparedWorkerError,
    apply_on_worker,
)
from split_drake.experiments.cluster.travel import (
    Freight,
    files_below,
    pack,
    require_light,
    unpack,
    write_files,
)
from split_drake.experiments.pool import WORKER_DIED, WorkerDiedError, too_long
from split_drake.experiments.provenance import processor

Item = TypeVar("Item")
Result = TypeVar("Result")

# How long a scheduler may take to answer at first, and to come back once it was there.
FIRST_S, PATIENCE_S = 30.0, 600.0
# How often it is looked whether the scheduler is still there, and how long a result may take to
# come from its worker before others are looked at.
_POLL_S, _GATHER_S = 0.5, 30.0
# Workers that may die or fail under an item, beside those that Dask itself tries.  Items run in
# processes of their own, so that it is hardly the item's doing.
_DEATHS = 3
# What says that the scheduler, or the connection to it, is not the one that it was.
_LOST = (CancelledError, FutureCancelledError, CommClosedError, ClosedClientError)


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
        address_of(scheduler)
        self._scheduler = scheduler
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
        freight = Freight()
        packed = [pack(item, self._run, freight, self._kept) for item in items]
        make_plugin = self._plugin_maker(freight)
        waiting, told, patience_s = dict(enumerate(items)), _Told(), FIRST_S
        with _ended_as_by_ctrl_c():
            while waiting:
                # A scheduler's file may name another address by now.
                address = address_of(self._scheduler)
                warn_if_open(address)
                connection = _Connection(connect(address, patience_s), make_plugin(), packed)
                try:
                    yield from self._run_on(connection, waiting, told)
                except _SchedulerLostError:
                    _say(f"the scheduler at {address} went away; waiting for it to come back")
                    patience_s = self._patience_s
                finally:
                    connection.close()
        if self._lost:
            raise WorkerDiedError("; ".join(self._lost))

    def _plugin_maker(self, freight: Freight) -> Callable[[], RunPlugin]:
        """Return what makes the run's plugin, with a name of its own for each connection.

        A plugin of a name that is known would end what its forerunner is at.
        """
        function = pack(self._function, self._run, freight, self._kept)
        contents, before, code = freight.contents(), _before(self._run, self._kept), Code.here()
        late = too_long(self._limit_s or 0.0)
        return lambda: RunPlugin(
            f"split-{uuid4().hex}",
            function,
            contents,
            self._kept,
            before,
            self._limit_s,
            WORKER_DIED,
            late,
            code,
        )

    def _run_on(
        self, connection: "_Connection", waiting: dict[int, Item], told: "_Told"
    ) -> Iterator[Result]:
        """Yield results, taking their items out of `waiting`, until all are there."""
        connection.submit_all(waiting)
        while waiting:
            number, answer = connection.next_answer()
            item = waiting.pop(number)
            told.note(answer.processor)
            yield from self._results(answer, item)

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


class _Connection:
    """The items of a run on one scheduler, as long as that is the same.

    Args:
        client: of the scheduler.
        plugin: that prepares its workers.
        packed: items, by number.
    """

    def __init__(self, client: Client, plugin: RunPlugin, packed: Sequence[bytes]) -> None:
        self._client, self._plugin, self._packed = client, plugin, packed
        self._comm = client.scheduler_comm
        self._done: SimpleQueue[tuple[int, Future]] = SimpleQueue()
        self._futures: dict[int, Future] = {}
        self._failures: Counter[int] = Counter()

    def submit_all(self, numbers: Collection[int]) -> None:
        """Prepare the workers, and hand out items."""
        try:
            self._client.register_plugin(self._plugin)
            if not self._client.scheduler_info()["workers"]:
                _say("the scheduler has no worker yet; waiting for some")
        except (*_LOST, TimeoutError) as error:
            raise _SchedulerLostError from error
        except ImportError as error:
            raise BadInputError(
                f"a worker cannot import {error.name}; expected this project to be installed there"
            ) from error
        for number in numbers:
            self._submit(number)

    def _submit(self, number: int) -> None:
        key = f"{self._plugin.name}-{number}-{self._failures[number]}"
        try:
            future = self._client.submit(
                apply_on_worker, self._plugin.name, self._packed[number], key=key, pure=False
            )
        except _LOST as error:
            raise _SchedulerLostError from error
        self._futures[number] = future
        future.add_done_callback(lambda ended: self._done.put((number, ended)))

    def next_answer(self) -> tuple[int, Answer]:
        """Return an item's number and what became of it.

        Raises _SchedulerLostError where the scheduler, or the connection to it, is another one.
        """
        while True:
            try:
                number, future = self._done.get(timeout=_POLL_S)
            except Empty:
                # Dask connects again by itself, but to a scheduler that may have forgotten all.
                if self._client.scheduler_comm is not self._comm:
                    raise _SchedulerLostError from None
                continue
            if self._futures.get(number) is not future:
                continue
            if (answer := self._answer(number, future)) is not None:
                del self._futures[number]
                return number, answer

    def _answer(self, number: int, future: Future) -> Answer | None:
        """Return an item's answer; None where it is waited for, or tried again."""
        try:
            answer: Answer = future.result(timeout=_GATHER_S)
            return answer
        except TimeoutError:  # its worker died with it, and it is worked out again
            self._done.put((number, future))
            return None
        except (*_LOST, UnpreparedWorkerError) as error:
            raise _SchedulerLostError from error
        except OtherWorkerError as error:
            raise BadInputError(f"{error}; a run needs the same on all its workers") from error
        except (KilledWorker, BrokenWorkerError) as error:
            return self._again(number, error)
        except Exception as error:  # of a worker that cannot even say what is wrong
            raise BadInputError(
                f"a worker failed with {type(error).__name__}: {error}; expected one with the same "
                "version of this project and of Dask"
            ) from error

    def _again(self, number: int, error: Exception) -> Answer | None:
        self._failures[number] += 1
        if self._failures[number] <= _DEATHS:
            self._submit(number)
            return None
        if isinstance(error, KilledWorker):
            return Answer(lost=WORKER_DIED)
        raise BadInputError(f"{error}; expected machines with room for the run") from error

    def close(self) -> None:
        """Leave the scheduler, ending what its workers are still at."""
        with suppress(Exception):  # it is gone, which is all that is wanted
            if self._client.status == "running":
                self._client.unregister_worker_plugin(self._plugin.name)
        with suppress(Exception):
            self._client.close(timeout=5.0)


class _Told:
    """Tells of processors, each once: outcomes differ in their last bits between them."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def note(self, name: str) -> None:
        """Tell of the processor that an item was worked on, where it is new."""
        if not name or name in self._known:
            return
        self._known.add(name)
        other = "" if name == processor() else f"; some outcomes may differ from {processor()}"
        _say(f"workers on {name}{other}")


def _before(run: Path | None, kept: Sequence[str]) -> dict[str, bytes]:
    """Return {place: content} of those entries of the run's folder that are there."""
    if run is None:
        return {}
    entries = [run / name for name in kept]
    files = [path for path in entries if path.is_file()]
    files += [path for entry in entries if entry.is_dir() for path in files_below(entry)]
    require_light(run, files)
    return {str(path.relative_to(run)): path.read_bytes() for path in files}


@contextmanager
def _ended_as_by_ctrl_c() -> Iterator[None]:
    """Have a request to end, or a connection that ends, stop the workers as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = (signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, signal.default_int_handler) for number in asked}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(text: str) -> None:
    print(text, file=sys.stderr)
