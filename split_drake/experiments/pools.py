"""The pool that a command's --scheduler asks for."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

from split_drake.bad_input import BadInputError
from split_drake.experiments.pool import InThisProcess, WorkerPool

Item = TypeVar("Item")
Result = TypeVar("Result")
_Item = TypeVar("_Item", contravariant=True)
_Result = TypeVar("_Result", covariant=True)

LOCAL = "local"


class Pool(Protocol[_Item, _Result]):
    """Applies a function to items, somewhere."""

    def run(self, items: Sequence[_Item]) -> Iterator[_Result]:
        """Yield one result an item, in order of completion."""
        ...


def make_pool(
    scheduler: str,
    workers: int,
    function: Callable[[Item], Result],
    on_crash: Callable[[Item, str], Result] | None = None,
    *,
    start_worker: Callable[[], None] | None = None,
    limit_s: float | None = None,
    run: Path | None = None,
    kept: Sequence[str] = (),
) -> Pool[Item, Result]:
    """Return the pool of a scheduler.

    Args:
        scheduler: "local" for processes of this machine, or where Dask's scheduler is, see
            `cluster.address.address_of`.
        workers: how many processes there are on this machine; Dask's scheduler knows its own.
        function, on_crash, start_worker, limit_s: see `WorkerPool`.
        run, kept: see `DaskPool`; on this machine they are where they are.

    Raises BadInputError where there is no such scheduler, or Dask is not installed.
    """
    if scheduler == LOCAL:
        return WorkerPool(function, workers, on_crash, start_worker, limit_s)
    require_scheduler(scheduler)
    # Dask is optional, and takes a second to import.
    from split_drake.experiments.cluster.dask_pool import DaskPool

    return DaskPool(scheduler, function, on_crash, start_worker, limit_s, run, kept)


def shard_pool(
    scheduler: str, workers: int, make: Callable[[Item], Result], out: Path
) -> Pool[Item, Result]:
    """Return what makes the shards of a dataset in the folder `out`; see `make_pool`.

    One worker of this machine is this process.
    """
    if scheduler == LOCAL and workers == 1:
        return InThisProcess(make)
    return make_pool(scheduler, workers, make, run=out)


def require_scheduler(scheduler: str) -> None:
    """Raise BadInputError where --scheduler is none, or Dask is not installed."""
    if scheduler == LOCAL:
        return
    try:
        from split_drake.experiments.cluster.address import address_of
    except ModuleNotFoundError as error:
        raise BadInputError(
            f"--scheduler is {scheduler!r}, which needs Dask: pip install 'split-drake[cluster]'"
        ) from error
    address_of(scheduler)
