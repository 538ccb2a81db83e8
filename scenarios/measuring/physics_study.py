"""What the physics is worth: `python -m scenarios.measuring.physics_study --out DIR`.

One thing changes at a time, the same seeds in every cell.  Time step, contact model and friction: a
free hand holds mugs still, and the table shows how deep the pads are in them and how far they slip.
Friction, mass, peg radius and peg tilt: trials of mug_hang with true poses, and how many succeed.

The folder holds config.json, trials.jsonl (a line as each trial ends), study.json and study.md; the
same --out goes on where an interrupted study stopped.
"""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from scenarios.study.cells import FACTORS, Cell, Factor, study_cells
from scenarios.study.report import print_study, study_rows, write_study
from scenarios.study.trials import (
    StudyRecord,
    StudyTrial,
    crashed_study_trial,
    run_study_trial,
    study_run,
)
from scenarios.trials.detection import TRIAL_STEP_S
from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.provenance import code_version
from split_drake.experiments.run import require_results
from split_drake.station.cameras.egl import check_rendering
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

# A trial takes a minute.
_LIMIT_S = 1800.0
_FREE_KEYS = ("out", "trials", "factors", "workers")


@dataclass(frozen=True)
class StudyOptions:
    """Options of a study.

    Attributes:
        out: folder of the results.
        trials: in each cell; trial i is seeded by seed + i in all of them.
        seed: of the first trial.
        factors: that are changed; the default's cells are always there.
        hold_s: how long a mug is held still.
        workers: processes; outcomes do not depend on them.
    """

    out: Path
    trials: int = 40
    seed: int = 0
    factors: tuple[Factor, ...] = FACTORS
    hold_s: float = 10.0
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if self.trials < 1:
            raise ValueError(f"--trials is {self.trials}; expected at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; expected 0 or more")
        if not self.hold_s > 0.0:
            raise ValueError(f"--hold-s is {self.hold_s}; expected seconds > 0")
        if self.workers < 1:
            raise ValueError(f"--workers is {self.workers}; expected at least 1")


def study_config(options: StudyOptions) -> dict[str, Any]:
    """Return the content of config.json."""
    return {**asdict(options), **code_version()}


def missing_trials(
    options: StudyOptions, cells: Sequence[Cell], records: Sequence[StudyRecord]
) -> list[StudyTrial]:
    """Return the trials of the cells that have no record yet."""
    done = {(record.cell, record.index) for record in records}
    return [
        StudyTrial(cell, index, options.seed + index, options.hold_s, options.out)
        for cell in cells
        for index in range(options.trials)
        if (cell.name, index) not in done
    ]


def main(options: StudyOptions) -> None:
    """Run what is missing of the study, and report."""
    console = Console()
    default = StationConfig(Layout(), time_step_s=TRIAL_STEP_S)
    run, cells = study_run(options.out), study_cells(default, options.factors)
    if any(cell.kind == "hang" for cell in cells):
        check_rendering()
    with run.claim(study_config(options), _FREE_KEYS, again=lambda record: record.failed_to_run):
        trials = missing_trials(options, cells, run.records())
        pool = WorkerPool(run_study_trial, options.workers, crashed_study_trial, limit_s=_LIMIT_S)
        run.collect(pool.run(trials), len(trials), console, describe=lambda found: found[-1].cell)
        asked = [record for record in run.records() if record.index < options.trials]
        rows = study_rows(cells, asked)
        write_study(options.out, rows)
    print_study(console, rows)
    console.print(f"results: {options.out / 'study.md'}")
    errors = [record.reason for record in asked if record.failed_to_run]
    require_results(errors, len(asked), options.out)


if __name__ == "__main__":
    run_command(main, StudyOptions, __doc__)
