"""Plans on a table that is higher than the robot's base."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planning.checking.goals.reorient import off_table
from planning.checking.trajectory_check import TrajectoryChecker
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject, voxel_centroids
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem
from planning.subgoal import Subgoal
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from tests.helpers.planning import (
    LYING,
    STANDING,
    configuration,
    mug_cloud,
    mug_problem,
    reorient_plan,
)
from tests.helpers.stations import raised_layout

HEIGHT_M = 0.10
RAISE = make_pose(p=(0.0, 0.0, HEIGHT_M))


def raised_problem(subgoal: Subgoal, X_WO: Array) -> PlanningProblem:
    return replace(mug_problem(subgoal, RAISE @ X_WO), layout=raised_layout(HEIGHT_M))


@cache
def raised_plan(subgoal: Subgoal) -> Plan:
    problem = raised_problem(subgoal, STANDING if subgoal is HANG else LYING)
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    return plan


@cache
def checker() -> TrajectoryChecker:
    return TrajectoryChecker(raised_layout(HEIGHT_M))


def cloud(X_WO: Array) -> Array:
    return voxel_centroids(transform_points(X_WO, mug_cloud()), 0.012)


@pytest.mark.parametrize("subgoal", [HANG, REORIENT], ids=str)
def test_a_plan_on_a_high_table_touches_nothing_of_it(subgoal: Subgoal) -> None:
    X_WO = RAISE @ (STANDING if subgoal is HANG else LYING)
    assert checker().violations(raised_plan(subgoal), cloud(X_WO)) == []


def test_an_object_is_stood_on_the_high_table() -> None:
    plan = raised_plan(REORIENT)
    assert plan.X_WGoal[2, 3] == pytest.approx(HEIGHT_M, abs=0.01)
    assert off_table(plan, raised_problem(REORIENT, LYING)) == ""
    low = replace(plan, X_WGoal=make_pose(p=(0.0, 0.0, -HEIGHT_M)) @ plan.X_WGoal)
    assert "-1" in off_table(low, raised_problem(REORIENT, LYING))


def test_the_checker_finds_a_plan_that_goes_through_the_high_table() -> None:
    found = checker().violations(reorient_plan(), cloud(STANDING))
    assert any("table" in violation.what for violation in found)


def test_what_is_held_keeps_off_the_high_table() -> None:
    q, world = configuration((0.5, 0.0, 0.35)), CollisionWorld(raised_layout(HEIGHT_M))
    X_GW = np.linalg.inv(gripper_pose(q))
    for z_m, free in ((0.09, False), (0.103, False), (0.12, True)):
        p_GHeld = transform_points(X_GW, np.array([[0.5, 0.0, z_m]]))
        assert bool(world.free(q[None], Situation(0.05, p_GHeld=p_GHeld))[0]) is free


def test_the_unseen_side_ends_at_the_high_table() -> None:
    sunk = RAISE @ make_pose(p=(0.5, 0.0, -0.02))
    seen = transform_points(sunk, mug_cloud())
    seen = seen[(seen[:, 2] > HEIGHT_M) & (seen[:, 1] > 0.0)]
    lower = PerceivedObject.from_cloud(seen, sunk, 0.0).p_WSurface
    assert PerceivedObject.from_cloud(seen, sunk, HEIGHT_M).p_WSurface[:, 2].min() > HEIGHT_M
    assert lower[:, 2].min() >= HEIGHT_M - 0.02
