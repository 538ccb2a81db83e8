"""How fast trials are on an idle machine: `python -m scenarios.measuring.speed --out DIR`.

Runs the same trials with one worker and with two, recordings included, and prints what they took
beside what the project promises.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from rich.console import Console
from rich.table import Table

from scenarios import mug_hang
from scenarios.trials.records import TrialRecord, trial_run
from split_drake.bad_input import BadInputError, require_count, require_numbers
from split_drake.experiments.command import run_command
from split_drake.files import interpreting, read_json_object

GIB = 2.0**30


@dataclass(frozen=True)
class SpeedOptions:
    """Which trials to time.

    Attributes:
        out: folder for the two runs; one that was interrupted goes on.
        trials: in each run.
        seed: of the first trial.
        detector: as in mug_hang.
    """

    out: Path
    trials: int = 40
    seed: int = 0
    detector: Literal["split", "oracle"] = "split"

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        require_count("trials", self.trials, 1)


@dataclass(frozen=True)
class Figure:
    """One measured number and its bound.

    Attributes:
        name: what is measured, with its unit.
        value: measured.
        bound: promised.
        at_most: whether the bound is an upper one.
    """

    name: str
    value: float
    bound: float
    at_most: bool

    @property
    def met(self) -> bool:
        return self.value <= self.bound if self.at_most else self.value >= self.bound


def figures(
    alone: Sequence[TrialRecord], alone_wall_s: float, both: Sequence[TrialRecord], wall_s: float
) -> list[Figure]:
    """Return the figures of the same trials run by one worker (`alone`) and by two (`both`).

    Raises BadInputError where they are not the same trials, or none was planned.
    """
    if [record.index for record in alone] != [record.index for record in both]:
        raise BadInputError(
            f"{len(alone)} trials by one worker and {len(both)} by two; expected the same trials"
        )
    planned = [record for record in alone if "planning" in record.seconds]
    if not planned:
        raise BadInputError(
            f"none of {len(alone)} trials came as far as planning; nothing is timed"
        )
    executed_s = sum(r.seconds["execution"] + r.seconds["verdict"] for r in planned)
    simulated_s = sum(record.simulated_s for record in planned)
    planning_s = float(np.median([record.seconds["planning"] for record in planned]))
    memory = max(record.memory_bytes for record in both) / GIB
    return [
        Figure("planning, median s a trial", planning_s, 1.0, True),
        Figure("simulated s a second, one core", simulated_s / executed_s, 3.0, False),
        Figure("minutes for 40 trials, two workers", wall_s / 60.0 * 40.0 / len(both), 6.0, True),
        Figure("GiB a worker, at most", memory, 1.5, True),
        Figure("two workers, times as fast as one", alone_wall_s / wall_s, 1.8, False),
    ]


def timed_run(options: SpeedOptions, workers: int) -> tuple[list[TrialRecord], float]:
    """Return the records of a whole run, and the wall time it took, s.

    Raises BadInputError where the run was interrupted, its folder holds more trials than asked for,
    or trials of a run that was killed, whose time nobody knows.
    """
    folder = options.out / f"{workers}_workers"
    before = len(trial_run(folder).records())
    if before and _timed_trials(folder) != before:
        raise BadInputError(
            f"{folder} holds {before} trials, and the time of {_timed_trials(folder)}: the run was "
            "killed; choose another --out"
        )
    mug_hang.main(
        mug_hang.MugHangOptions(
            trials=options.trials,
            seed=options.seed,
            detector=options.detector,
            workers=workers,
            out=folder,
        )
    )
    records = trial_run(folder).records()
    if len(records) < options.trials:
        raise BadInputError(
            f"{folder} holds {len(records)} of {options.trials} trials: the run was interrupted; "
            "the same command goes on from there"
        )
    if len(records) > options.trials:
        raise BadInputError(
            f"{folder} holds {len(records)} trials, --trials is {options.trials}; expected as many "
            "as it holds, or another --out"
        )
    return records, mug_hang.earlier_wall_s(folder)


def _timed_trials(folder: Path) -> int:
    """Return how many trials the run's wall time is that of."""
    path = folder / "summary.json"
    if not path.exists():
        return 0
    with interpreting(path, what := "the summary of a run"):
        return int(read_json_object(path, what)["trials"])


def main(options: SpeedOptions) -> list[Figure]:
    """Run both, print the table, and return its figures."""
    console = Console()
    alone, alone_wall_s = timed_run(options, workers=1)
    both, wall_s = timed_run(options, workers=2)
    found = figures(alone, alone_wall_s, both, wall_s)
    table = Table("figure", "measured", "promised", "")
    for figure in found:
        bound = f"{'<=' if figure.at_most else '>='} {figure.bound:g}"
        table.add_row(figure.name, f"{figure.value:.2f}", bound, "" if figure.met else "missed")
    console.print(table)
    return found


if __name__ == "__main__":
    run_command(main, SpeedOptions, __doc__)
