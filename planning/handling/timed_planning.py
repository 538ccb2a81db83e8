"""How long a planner takes, measured around its call."""

import time
from dataclasses import dataclass

import numpy as np

from planning.planner import Planner
from planning.problem import Plan, PlanFailure, PlanningProblem


@dataclass(frozen=True)
class TimedOutcome:
    """What a planner returned, and the wall time that it took, s."""

    outcome: Plan | PlanFailure
    took_s: float


def plan_timed(
    planner: Planner, problem: PlanningProblem, rng: np.random.Generator
) -> TimedOutcome:
    """Plan, and say how long it took."""
    started = time.monotonic()
    outcome = planner.plan(problem, rng)
    return TimedOutcome(outcome, time.monotonic() - started)
