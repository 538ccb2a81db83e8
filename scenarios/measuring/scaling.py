"""What more workers bring: `python -m scenarios.measuring.scaling`.

Trials are run by Dask workers of this machine, one and more of them; so are items that do nothing,
which shows what the scheduler itself can do.  What many workers would come to is computed from
that: they do as many trials at once, until the scheduler or the network is the limit.
"""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from rich.console import Console
from rich.table import Table

from scenarios import mug_hang
from split_drake.bad_input import BadInputError, require_count, require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.pools import make_pool, require_scheduler
from split_drake.experiments.provenance import processor

COMPUTED = (10, 100, 1000)
# What a gigabit network carries, and of it what is left beside everything else.
NETWORK_BYTES_PER_S = 0.5 * 125e6


@dataclass(frozen=True)
class ScalingOptions:
    """What is measured.

    Attributes:
        trials: of the mug experiment for each worker.
        items: that do nothing, for each worker.
        workers: how many of this machine are measured, in turn.
        record: which trials keep a recording; it comes back to this machine.
        seed: of the first trial.
    """

    trials: int = 4
    items: int = 2000
    workers: tuple[int, ...] = (1, 2)
    record: Literal["all", "failures", "none"] = "all"
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("trials", "items"):
            require_count(f"--{name}", getattr(self, name), 1)
        require_count("--seed", self.seed)
        if not self.workers or min(self.workers) < 1:
            raise BadInputError(f"--workers is {list(self.workers)}; expected counts from 1 on")


@dataclass(frozen=True)
class Measured:
    """What some workers came to.

    Attributes:
        workers: how many.
        trial_s: mean seconds of one worker for a trial.
        start_s: seconds until a worker's process answers its first item.
        items_per_s: that do nothing, all workers together.
        bytes_per_trial: that come back of a trial.
    """

    workers: int
    trial_s: float
    start_s: float
    items_per_s: float
    bytes_per_trial: float

    @property
    def trials_per_hour(self) -> float:
        return 3600.0 * self.workers / self.trial_s


def computed_trials_per_hour(measured: Sequence[Measured], workers: int) -> float:
    """Return the trials that so many workers do in an hour.

    They are as fast as the slowest that were measured.  The scheduler passes on as many items as
    it did here at best, and what comes back has to go through a network of one gigabit a second.
    """
    by_workers = workers / max(each.trial_s for each in measured)
    by_scheduler = max(each.items_per_s for each in measured)
    by_network = NETWORK_BYTES_PER_S / max(each.bytes_per_trial for each in measured)
    return 3600.0 * min(by_workers, by_scheduler, by_network)


def nothing(item: int) -> int:
    """Return the item."""
    return item


@contextmanager
def _cluster(workers: int) -> Iterator[str]:
    """Start workers of one thread each on this machine, and give their scheduler's address."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield str(cluster.scheduler_address)


def _nothings(address: str, count: int) -> tuple[float, float]:
    """Return seconds until the first of `count` items is there, and from it to the last."""
    begun = time.monotonic()
    results = make_pool(address, 1, nothing).run(range(count + 1))
    next(results)
    first = time.monotonic()
    for _ in results:
        pass
    return first - begun, time.monotonic() - first


def _bytes_below(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def measure(options: ScalingOptions, workers: int, scratch: Path) -> Measured:
    """Return what `workers` workers of this machine come to."""
    with _cluster(workers) as address:
        start_s, items_s = _nothings(address, options.items * workers)
        count, out = options.trials * workers, scratch / str(workers)
        trials = mug_hang.MugHangOptions(
            trials=count, seed=options.seed, record=options.record, scheduler=address, out=out
        )
        begun = time.monotonic()
        mug_hang.main(trials)
        trials_s = time.monotonic() - begun - start_s
    return Measured(
        workers,
        trials_s / options.trials,
        start_s,
        options.items * workers / items_s,
        _bytes_below(out) / count,
    )


def to_table(measured: Sequence[Measured]) -> Table:
    """Return a table of what was measured, and of what more workers come to."""
    table = Table("workers", "trials an hour", "seconds a trial", "nothings a second", "")
    for each in measured:
        table.add_row(
            str(each.workers),
            f"{each.trials_per_hour:.0f}",
            f"{each.trial_s:.1f}",
            f"{each.items_per_s:.0f}",
            "measured",
        )
    for workers in COMPUTED:
        rate = computed_trials_per_hour(measured, workers)
        table.add_row(str(workers), f"{rate:.0f}", "", "", "computed")
    return table


def main(options: ScalingOptions) -> list[Measured]:
    """Measure, print, and return what was measured."""
    require_scheduler("127.0.0.1:8786")  # that Dask is there
    console = Console(soft_wrap=True)
    with TemporaryDirectory() as scratch:
        measured = [measure(options, count, Path(scratch)) for count in options.workers]
    console.print(f"{processor()}, {len(os.sched_getaffinity(0))} cores")
    console.print(to_table(measured))
    most = max(measured, key=lambda each: each.bytes_per_trial)
    console.print(
        f"{most.bytes_per_trial / 1e6:.2f} MB come back of a trial; a process answers its first "
        f"item after {max(each.start_s for each in measured):.1f} s"
    )
    return measured


if __name__ == "__main__":
    run_command(main, ScalingOptions, __doc__)
