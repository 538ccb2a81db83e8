"""Grow the regions of the planner `gcs`: `python -m scenarios.making.grow_regions`.

The default planner solves saved problems; where its transits and transfers start, turn and end are
the configurations that regions should hold.  Home comes first.  After a change of `Layout`, record
problems of the new station first (`scenarios.record_problems`) and name them by --problems.
"""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from planning.collision.world import CollisionWorld, Situation
from planning.motion.regions import SHIPPED_REGIONS, grow_regions, save_regions
from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem
from planning.problem_files import SHIPPED_PROBLEMS, load_problems
from scenarios.bench.plan_measures import FREE_SEGMENTS
from split_drake.bad_input import BadInputError, require_numbers
from split_drake.experiments.command import run_command
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout, same_fixtures


@dataclass(frozen=True)
class GrowOptions:
    """Options of growing.

    Attributes:
        problems: file of `scenarios.record_problems`, of the station that `Layout()` describes.
        plans: how many of its problems to plan.
        max_regions: how many regions to grow at most.
        seed: of planner and sampling.
        out: the regions' file.
    """

    problems: Path = SHIPPED_PROBLEMS
    plans: int = 60
    max_regions: int = 40
    seed: int = 0
    out: Path = SHIPPED_REGIONS

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        for name in ("plans", "max_regions"):
            if getattr(self, name) < 1:
                raise ValueError(f"--{name} is {getattr(self, name)}; expected at least 1")


def turning_points(plan: Plan) -> Array:
    """Return (N, 7) where the free motions of a plan start, are half way, and end."""
    trajectories = [s.trajectory.qs for s in plan.segments if s.name in FREE_SEGMENTS]
    return np.concatenate([qs[[0, len(qs) // 2, -1]] for qs in trajectories])


def load_station_problems(path: Path) -> list[PlanningProblem]:
    """Return the problems of a file.

    Raises BadInputError where table or hook of one stand elsewhere than in `Layout()`: the regions
    would be of a station that is no longer there, and the planner would refuse to use them.
    """
    problems = load_problems(path)
    for name, problem in problems.items():
        if not same_fixtures(problem.layout, Layout()):
            raise BadInputError(
                f"{path}: table or hook of problem {name!r} are not those of Layout(); record "
                "problems of this station with scenarios.record_problems and name them by "
                "--problems"
            )
    return list(problems.values())


def main(options: GrowOptions) -> Path:
    """Grow the regions and return their file."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    console = Console()
    problems = load_station_problems(options.problems)[: options.plans]
    planner, found = make_planner("default"), [Q_HOME[None]]
    for problem in track(problems, "planning", console=console):
        plan = planner.plan(problem, np.random.default_rng(options.seed))
        if isinstance(plan, Plan):
            found.append(turning_points(plan))
    world, qs = CollisionWorld(Layout()), np.concatenate(found)
    qs = qs[world.free(qs, Situation(MAX_OPENING_M))]
    regions = grow_regions(world, qs, options.max_regions, options.seed)
    save_regions(options.out, regions)
    covered = regions.covers(qs).mean()
    console.print(
        f"{len(regions)} regions, {len(regions.edges) // 2} pairs of them intersect; they hold "
        f"{covered:.0%} of {len(qs)} configurations of plans: {options.out}"
    )
    return options.out


if __name__ == "__main__":
    run_command(main, GrowOptions, __doc__)
