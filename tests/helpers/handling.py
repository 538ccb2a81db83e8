"""One pick by a made-up robot with a planner that always answers the same, for tests of it.

The robot sees nothing unless a test says what.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from planning.execution.executor import Executor
from planning.goals.upright import SUBGOAL as REORIENT
from planning.handling.attempts import AttemptLimits, Perception
from planning.handling.handler import Handler, PickOutcome
from planning.handling.held_view import HeldView
from planning.problem import Plan, PlanFailure, PlanningProblem, Segment, SegmentName, Stage
from split_drake.poses import Array
from split_drake.robot.kinematics import gripper_pose
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import Layout
from tests.helpers.planning import STANDING, mug_problem, reorient_plan
from tests.helpers.robot import PerfectRobot

WIDTH_M = 0.010


@dataclass
class Placer:
    """Answers with the same placement each time, or with None; keeps what it was asked."""

    plan_found: Plan | None = None
    asked: list[PlanningProblem] = field(default_factory=list)

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        self.asked.append(problem)
        return self.plan_found or PlanFailure(Stage.PLANNING, "out of reach")


def placing() -> Plan:
    """Return the rest of the plan, for an object that is in the hand."""
    return replace(reorient_plan(), segments=reorient_plan().place)


def handle(
    robot: PerfectRobot,
    planner: Placer,
    on_step: Callable[[Segment], None] | None = None,
    limits: AttemptLimits | None = None,
    plan: Plan | None = None,
) -> PickOutcome:
    problem = mug_problem(REORIENT, STANDING)
    scene = Scene.from_points(problem.p_WPs, Workspace())
    perception = Perception(
        scene, problem.pose_sets, problem.p_WPs, np.empty((0, 3)), in_view=1, duration_s=0.1
    )
    handler = Handler(planner, Executor(robot, on_step), Layout(), limits or AttemptLimits())
    return handler.handle(plan or reorient_plan(), perception, 0.5, np.random.default_rng(0))


def sees(monkeypatch: pytest.MonkeyPatch, X_GE: Array) -> None:
    monkeypatch.setattr(
        "planning.handling.handler.view_held", lambda *_: HeldView(X_GE, matched=1.0)
    )


def failures(handled: PickOutcome) -> list[Stage | None]:
    return [attempt.failure[0] for attempt in handled.attempts]


def blocking_floor_m() -> float:
    """Return a height that the gripper goes through on the way in."""
    insertion = reorient_plan().place[1].trajectory
    return float(np.mean([gripper_pose(q)[2, 3] for q in insertion.qs[[0, -1]]]))


def catch(robot: PerfectRobot, normal_W: tuple[float, float, float]) -> Callable[[Segment], None]:
    """Return what catches the robot's hand on a wall once it has begun to draw back."""

    def on_step(segment: Segment) -> None:
        if segment.name is SegmentName.RETREAT and robot.floor_m == -np.inf:
            robot.normal_W = normal_W
            robot.floor_m = float(np.dot(normal_W, gripper_pose(robot.q)[:3, 3]))

    return on_step
