"""Run planners on saved problems: `python -m scenarios.planner_bench --planner default rrt gcs`.

Nothing is simulated.  Every plan is checked by `planning.checking.checked_planner`: that it does
what its problem asks for, and touches nothing but what it declares.  One that is refused does not
count as solved.  A planner keeps its own limit of time; --limit-s ends one that hangs.
Problems are refused up front where `planning/checking/goals` has no file that says where plans to
their subgoal must end.

With `--problems FILE.yaml` planners join configurations and poses among boxes and cylinders by
their free motions alone: robometrics' and MotionBenchMaker's problems for the Panda, in their keys
(scenarios/bench/motions/robometrics_file.py).  `--export FILE.yaml` writes the free motions of the
problems so, and ends.

The output folder holds config.json, results.jsonl (a line for each problem and planner as it
arises), summary.json and index.html.  The same --out goes on where an interrupted run stopped.
The report is of the planners and problems asked for, whatever else the folder holds; pairs of
planners are compared on the problems that all of them have been given.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from planning.checking.goal_checks import require_checks_in_files
from planning.planner import planner_names
from planning.problem_files import SHIPPED_PROBLEMS, load_problems
from scenarios.bench.motions.export import exported
from scenarios.bench.motions.robometrics_file import read_motion_problems, write_motion_problems
from scenarios.bench.motions.run import motion_of
from scenarios.bench.page import page_of
from scenarios.bench.records import (
    MOTION,
    BenchRecord,
    BenchTask,
    bench_run,
    crashed_task,
    run_task,
)
from scenarios.bench.report import print_bench, write_bench_summary
from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.pages.render import render
from split_drake.experiments.pools import LOCAL, make_pool, require_scheduler
from split_drake.experiments.provenance import code_version, file_sha256
from split_drake.experiments.run import as_json, require_results
from split_drake.files import write_atomically


@dataclass(frozen=True)
class BenchOptions:
    """Options of a bench.

    Attributes:
        planner: names of planners; on each problem another one goes first.
        problems: file of `scenarios.record_problems`, or a YAML file of motions; those that ship
            with the project by default.
        export: a YAML file to write the problems' free motions to, in place of a bench.
        limit: use only the first so many problems of the file.
        seed: with the problem's number in the file, of all planners: they draw alike on one
            problem, and otherwise on the next.
        workers: processes; more than one disturbs the times.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
        limit_s: a planner that takes longer on a problem is ended, and recorded as an error.
        out: folder of the results; runs/planner_bench/<time> where not given.
    """

    planner: tuple[str, ...] = ("default",)
    problems: Path = SHIPPED_PROBLEMS
    export: Path | None = None
    limit: int | None = None
    seed: int = 0
    workers: int = 1
    scheduler: str = LOCAL
    limit_s: float = 1800.0
    out: Path | None = None

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if not self.limit_s > 0.0:
            raise ValueError(f"--limit-s is {self.limit_s}; expected seconds > 0")
        known = planner_names()
        unknown = [name for name in self.planner if name not in known]
        if unknown or not self.planner:
            raise ValueError(f"--planner is {list(self.planner)}; expected some of {list(known)}")
        if len(set(self.planner)) < len(self.planner):
            raise ValueError(f"--planner names one twice: {list(self.planner)}")
        if self.limit is not None and self.limit < 1:
            raise ValueError(f"--limit is {self.limit}; expected at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; expected 0 or more")
        if self.workers < 1:
            raise ValueError(f"--workers is {self.workers}; expected at least 1")
        if self.export is not None and self.has_motions:
            raise ValueError(f"--export: {self.problems} holds motions already; expected an npz")

    @property
    def has_motions(self) -> bool:
        """Whether the problems are motions among boxes and cylinders."""
        return self.problems.suffix in (".yaml", ".yml")


# What may differ when a bench goes on: it changes no plan, and no time.
_FREE_KEYS = ("planner", "scheduler", "limit", "limit_s", "out", "problems", "export")


def bench_config(options: BenchOptions) -> dict[str, Any]:
    """Return the content of config.json."""
    return {
        **as_json(asdict(options)),
        "problems_sha256": file_sha256(options.problems),
        "cpus": len(os.sched_getaffinity(0)),
        **code_version(),
    }


def missing_tasks(
    options: BenchOptions, subgoals: Mapping[str, str], records: Sequence[BenchRecord]
) -> list[BenchTask]:
    """Return a task for each of the file's problems and planners that has not been run yet.

    Planners take turns at going first.

    Args:
        options: of the bench.
        subgoals: {problem: name of its subgoal}, in the file's order.
        records: of what has been run.
    """
    done = {(record.problem, record.planner) for record in records}
    tasks = []
    for number, (name, subgoal) in enumerate(subgoals.items()):
        first = number % len(options.planner)
        for planner in (*options.planner[first:], *options.planner[:first]):
            if (name, planner) not in done:
                seed = (options.seed, number)
                tasks.append(BenchTask(options.problems, name, subgoal, planner, seed))
    return tasks


def subgoals_of(options: BenchOptions) -> dict[str, str]:
    """Return {problem: name of its subgoal} of the problems asked for, in the file's order.

    Motions have `MOTION` in place of a subgoal.  Raises SystemExit where plans to a problem could
    not be checked, and BadInputError where a planner has no free motions of its own.
    """
    if options.has_motions:
        for planner in options.planner:
            motion_of(planner)
        names = list(read_motion_problems(options.problems))[: options.limit]
        return dict.fromkeys(names, MOTION)
    problems = list(load_problems(options.problems).items())[: options.limit]
    subgoals = {name: problem.subgoal.name for name, problem in problems}
    try:
        require_checks_in_files(subgoals.values())
    except ValueError as error:
        raise SystemExit(f"{options.problems} cannot be benched: {error}") from error
    return subgoals


def export_motions(options: BenchOptions, path: Path, console: Console) -> Path:
    """Write the problems' free motions to a file, and return it."""
    problems = dict(list(load_problems(options.problems).items())[: options.limit])
    motions, unsolved = exported(problems, options.seed)
    write_motion_problems(path, motions)
    counts = ", ".join(f"{len(found)} of {name}" for name, found in motions.items())
    console.print(f"{path}: {counts}; {unsolved} of {len(problems)} problems were not solved")
    return path


def main(options: BenchOptions) -> Path:
    """Run what is missing of the bench, report, and return the folder; or export the problems."""
    console = Console()
    require_scheduler(options.scheduler)
    if options.export is not None:
        return export_motions(options, options.export, console)
    folder = options.out or Path("runs/planner_bench") / datetime.now().strftime("%Y%m%d-%H%M%S")
    subgoals = subgoals_of(options)
    config, run = bench_config(options), bench_run(folder)
    with run.claim(config, _FREE_KEYS, again=lambda record: record.failed_to_run):
        tasks = missing_tasks(options, subgoals, run.records())
        pool = make_pool(
            options.scheduler, options.workers, run_task, crashed_task, limit_s=options.limit_s
        )
        run.collect(pool.run(tasks), len(tasks), console)
        asked = [r for r in run.records() if r.problem in subgoals and r.planner in options.planner]
        write_bench_summary(folder / "summary.json", asked, options.planner, config)
        write_atomically(folder / "index.html", render(page_of(asked, config)))
    print_bench(console, asked, options.planner)
    console.print(f"results: {folder}")
    errors = [record.reason for record in asked if record.failed_to_run]
    require_results(errors, len(asked), folder)
    return folder


if __name__ == "__main__":
    run_command(main, BenchOptions, __doc__)
