"""What the physics is worth: `python -m scenarios.physics_study --out DIR`.

One thing changes at a time, the same seeds in every cell.  Time step, contact model and friction: a
free hand holds mugs still, and the table shows how deep the pads are in them and how far they slip.
Friction, mass, peg radius and peg tilt: trials of mug_hang with true poses, and how many succeed.

The folder holds config.json, trials.jsonl (a line as each trial ends), study.json and study.md; the
same --out goes on where an interrupted study stopped.
"""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from scenarios.study.cells import FACTORS, Cell, Factor, study_cells
from scenarios.study.report import print_study, study_rows, write_study
from scenarios.study.trials import StudyRecord, StudyTrial, crashed_study_trial, run_study_trial
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.provenance import code_version
from split_drake.experiments.run import claim_folder, read_json_lines
from split_drake.files import write_atomically

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
        if self.trials < 1:
            raise ValueError(f"--trials is {self.trials}; expected at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; expected 0 or more")
        if not self.hold_s > 0.0:
            raise ValueError(f"--hold-s is {self.hold_s}; expected seconds > 0")
        if self.workers < 1:
            raise ValueError(f"--workers is {self.workers}; expected at least 1")


def open_study(options: StudyOptions) -> list[StudyRecord]:
    """Write config.json, and return what the folder holds already of any cell.

    Raises ValueError where it was made with other options or code.
    """
    config: dict[str, Any] = {**asdict(options), "out": str(options.out)}
    config |= {"factors": list(options.factors)}
    config |= code_version()
    claim_folder(options.out, config, _FREE_KEYS)
    log = options.out / "trials.jsonl"
    records = [StudyRecord(**fields) for fields in read_json_lines(log)]
    # A kill may have cut off the last line; what is appended must start on one of its own.
    write_atomically(log, "".join(record.to_json() + "\n" for record in records))
    return records


def run_missing(
    options: StudyOptions, cells: tuple[Cell, ...], records: list[StudyRecord], console: Console
) -> None:
    """Run what is missing, appending each record to the list and to trials.jsonl as it ends."""
    done = {(record.cell, record.index) for record in records}
    trials = [
        StudyTrial(cell, index, options.seed + index, options.hold_s, options.out)
        for cell in cells
        for index in range(options.trials)
        if (cell.name, index) not in done
    ]
    if not trials:
        return
    pool = WorkerPool(run_study_trial, crashed_study_trial, min(options.workers, len(trials)))
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with (
        (options.out / "trials.jsonl").open("a") as log,
        Progress(*columns, TimeRemainingColumn(), console=console) as progress,
    ):
        bar = progress.add_task("", total=len(trials))
        for record in pool.run(trials):
            log.write(record.to_json() + "\n")
            log.flush()
            records.append(record)
            progress.update(bar, advance=1, description=record.cell)


def main(options: StudyOptions) -> None:
    """Run what is missing of the study, and report."""
    console = Console()
    records, cells = open_study(options), study_cells(options.factors)
    try:
        run_missing(options, cells, records, console)
    except KeyboardInterrupt:
        console.print(f"interrupted; --out {options.out} goes on from here")
    asked_for = [record for record in records if record.index < options.trials]
    rows = study_rows(cells, asked_for)
    write_study(options.out, rows)
    print_study(console, rows)
    console.print(f"results: {options.out / 'study.md'}")


if __name__ == "__main__":
    main(tyro.cli(StudyOptions, description=__doc__))
