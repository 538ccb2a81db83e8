"""A planner whose plans are checked independently, for those who want to know and have the time."""

import numpy as np

from planning.checking.plan_contract import contract_violations
from planning.checking.trajectory_check import TrajectoryChecker
from planning.checking.violation import Violation
from planning.geometry.perceived import voxel_centroids
from planning.planner import Planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage
from split_drake.station.layout import Layout, same_fixtures

# Plans are checked against the perceived cloud, thinned to voxels of this edge.
CHECK_VOXEL_M = 0.012


class PlanChecker:
    """Says what is wrong with plans for a layout.

    Shares with what makes them which contacts may be declared and, for the plan's ends alone, the
    kinematics and the completed cloud.

    Attributes:
        layout: of the static station.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._trajectories = TrajectoryChecker(layout)

    def violations(self, plan: Plan, problem: PlanningProblem) -> list[Violation]:
        """Return what keeps the plan from solving the problem; empty where nothing does.

        What it touches is looked at where it is a plan for the problem at all.
        """
        found = contract_violations(plan, problem)
        others = voxel_centroids(problem.p_WObstacles, CHECK_VOXEL_M)
        return found or self._trajectories.violations(plan, check_points(problem), others)


class CheckedPlanner:
    """Plans as another planner does, but for plans in which the independent check finds a fault.

    These are no plans: a failure at Stage.CHECK stands for them, and they are not executed.

    Attributes:
        violations: of all plans so far.

    Args:
        planner: that plans.
    """

    def __init__(self, planner: Planner) -> None:
        self.violations: list[Violation] = []
        self._planner = planner
        self._checker: PlanChecker | None = None

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        """Return the other planner's outcome; a failure where that is a plan with a fault."""
        outcome = self._planner.plan(problem, rng)
        if not isinstance(outcome, Plan):
            return outcome
        found = self._checker_of(problem).violations(outcome, problem)
        self.violations += found
        if not found:
            return outcome
        return PlanFailure(Stage.CHECK, "; ".join(map(str, found)), outcome.statistics)

    def _checker_of(self, problem: PlanningProblem) -> PlanChecker:
        if self._checker is None or not same_fixtures(problem.layout, self._checker.layout):
            self._checker = PlanChecker(problem.layout)
        return self._checker


def check_points(problem: PlanningProblem) -> np.ndarray:
    """Return the points (N, 3) of the problem's object that its plans are checked against."""
    return voxel_centroids(problem.p_WPs, CHECK_VOXEL_M)
