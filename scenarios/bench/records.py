"""What becomes of one problem with one planner, and the planning and checking that finds out."""

import logging
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from planning.checking.checked_planner import PlanChecker, check_points
from planning.planner import Planner, make_planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage
from planning.problem_files import load_problems
from scenarios.bench.motions.problem import MotionProblem
from scenarios.bench.motions.robometrics_file import read_motion_problems
from scenarios.bench.motions.run import MotionTask, motion_of
from scenarios.bench.plan_measures import PlanMeasures, PlanMeter, measure_motion
from split_drake.experiments.pool import WORKER_DIED
from split_drake.experiments.run import RunFolder
from split_drake.station.layout_file import layout_from_json, layout_to_json

SOLVED = "solved"
# A plan that the independent checker refuses; a planner that raised, or whose plan made the check
# or the measuring raise.
REFUSED = "refused by the checker"
ERROR = "error"
# What the problems of a file of motions are for, where others have a subgoal.
MOTION = "motion"

_PLANNERS: dict[str, Planner] = {}


@dataclass(frozen=True)
class BenchRecord:
    """What became of one problem with one planner.

    Attributes:
        problem: its name.
        planner: its name.
        outcome: "solved", the stage that failed, "refused by the checker", or "error".
        reason: why, in words, or the traceback of an error; empty where solved.
        planning_s: wall time of the planner; None where that is not known, after a crash.
        planning_cpu_s: processor time of the planner, which other programs hardly change.
        measures: of the plan; None where the problem is not solved.
        search: the planner's own counts.
        subgoal: of the problem, by name; empty in records that were written without it.
    """

    problem: str
    planner: str
    outcome: str
    reason: str
    planning_s: float | None
    planning_cpu_s: float | None
    measures: PlanMeasures | None = None
    search: Mapping[str, float] = field(default_factory=dict)
    subgoal: str = ""

    @property
    def solved(self) -> bool:
        return self.outcome == SOLVED

    @property
    def failed_to_run(self) -> bool:
        """Whether an error, a crash or the limit of time ended it: it is tried again."""
        return self.outcome == ERROR

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        measures = fields["measures"]
        return cls(**{**fields, "measures": measures and PlanMeasures(**measures)})


def bench_run(folder: Path) -> RunFolder[BenchRecord]:
    """Return the folder of a bench, whose log is results.jsonl."""
    return RunFolder(folder, "results.jsonl", BenchRecord.from_fields)


@dataclass(frozen=True)
class BenchTask:
    """One problem of a file for one planner.

    Attributes:
        file: of the problems.
        problem: name of the problem.
        subgoal: of the problem, by name.
        planner: its name.
        seed: of every planner on the problem: that of the bench, and the problem's number.
    """

    file: Path
    problem: str
    subgoal: str
    planner: str
    seed: tuple[int, int]


def run_task(task: BenchTask) -> BenchRecord:
    """Plan, and record what became of it."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    if task.subgoal == MOTION:
        return _run_motion(task)
    problem = _problems(task.file)[task.problem]
    make = partial(_warm_planner, task.planner, problem)
    return run_planner(make, task.planner, problem, task.problem, task.seed)


def crashed_task(task: BenchTask, reason: str = WORKER_DIED) -> BenchRecord:
    """Return the record of a task whose process died, or was killed."""
    return BenchRecord(task.problem, task.planner, ERROR, reason, None, None, subgoal=task.subgoal)


def run_planner(
    make: Callable[[], Planner],
    planner_name: str,
    problem: PlanningProblem,
    problem_name: str,
    seed: Sequence[int],
) -> BenchRecord:
    """Make the planner, plan, check the plan independently, and measure it.

    Where any of this raises, the record is an error with the traceback.
    """
    seconds: tuple[float | None, float | None] = (None, None)
    record = partial(BenchRecord, problem_name, planner_name, subgoal=problem.subgoal.name)
    try:
        planner = make()
        started, started_cpu = time.perf_counter(), time.process_time()
        try:
            outcome = planner.plan(problem, np.random.default_rng(seed))
        finally:
            seconds = (time.perf_counter() - started, time.process_time() - started_cpu)
        verdict, reason, measures = _judged(outcome, problem)
        search = {name: float(value) for name, value in outcome.statistics.items()}
    except Exception:
        return record(ERROR, traceback.format_exc(), *seconds)
    return record(verdict, reason, *seconds, measures, search)


def _run_motion(task: BenchTask) -> BenchRecord:
    """Plan a motion of a file, check it, and measure it."""
    seconds: tuple[float | None, float | None] = (None, None)
    record = partial(BenchRecord, task.problem, task.planner, subgoal=MOTION)
    try:
        made, motion = _motion_task(task.file, task.problem), motion_of(task.planner)
        started, started_cpu = time.perf_counter(), time.process_time()
        outcome = made.plan(motion, np.random.default_rng(task.seed))
        seconds = (time.perf_counter() - started, time.process_time() - started_cpu)
        if isinstance(outcome, str):
            return record(Stage.PLANNING.value, outcome, *seconds)
        if fault := made.fault(outcome):
            return record(REFUSED, fault, *seconds)
        opening_m = made.situation.opening_m
        measures = measure_motion(made.world.checker, outcome, opening_m)
        return record(SOLVED, "", *seconds, measures)
    except Exception:
        return record(ERROR, traceback.format_exc(), *seconds)


@lru_cache(maxsize=1)
def _motion_task(file: Path, name: str) -> MotionTask:
    """Return a problem in its world, which all planners share: they take turns on a problem."""
    return MotionTask.of(_motions(file)[name])


@lru_cache(maxsize=1)
def _motions(file: Path) -> dict[str, MotionProblem]:
    return read_motion_problems(file)


def _judged(
    outcome: Plan | PlanFailure, problem: PlanningProblem
) -> tuple[str, str, PlanMeasures | None]:
    """Return the outcome in a word, the reason, and the measures of a plan that solves."""
    if isinstance(outcome, PlanFailure):
        return outcome.stage.value, outcome.reason, None
    checker, meter = _judges(layout_to_json(problem.layout))
    violations = checker.violations(outcome, problem)
    if violations:
        return REFUSED, str(violations[0]), None
    return SOLVED, "", meter.measure(outcome, check_points(problem))


@lru_cache(maxsize=1)
def _problems(file: Path) -> dict[str, PlanningProblem]:
    return load_problems(file)


def _warm_planner(name: str, problem: PlanningProblem) -> Planner:
    """Return this process's planner of that name.

    A new one plans the problem once before: what is built at the first plan is no part of any time,
    and a crash then is this problem's.
    """
    if name not in _PLANNERS:
        planner = make_planner(name)
        with suppress(Exception):  # it will raise again where that is recorded
            planner.plan(problem, np.random.default_rng(0))
        _PLANNERS[name] = planner
    return _PLANNERS[name]


@lru_cache(maxsize=1)
def _judges(layout_json: str) -> tuple[PlanChecker, PlanMeter]:
    """Return what checks and what measures plans for a layout, given as JSON."""
    layout = layout_from_json(layout_json)
    return PlanChecker(layout), PlanMeter(layout)
