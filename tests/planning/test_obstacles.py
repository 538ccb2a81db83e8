"""Plans among other things: they keep clear of them, and the check finds those that do not."""

from dataclasses import replace

import numpy as np
import pytest

from planning.checking.checked_planner import PlanChecker
from planning.checking.plan_contract import contract_violations
from planning.collision.world import CollisionWorld, Situation
from planning.planner import make_planner
from planning.problem import Plan, PlanFailure, PlanningProblem
from planning.subgoal import AllowedContact, find_subgoal
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout
from tests.helpers.clutter import box_cloud
from tests.helpers.planning import STANDING, configuration, mug_problem

HANG, REORIENT = find_subgoal("hang"), find_subgoal("reorient")
TOUCHING = frozenset({AllowedContact.FINGERS_TARGET})


def planned(problem: PlanningProblem) -> Plan | PlanFailure:
    return make_planner("default").plan(problem, np.random.default_rng(0))


def in_the_way(plan: Plan) -> Array:
    """Return a box where the fingers pass on their way in."""
    approach = next(s for s in plan.segments if s.name == "approach")
    X_WG = gripper_pose(approach.trajectory.qs[0])
    beside = transform_points(X_WG, np.array([[0.0, 0.055, 0.0]]))[0]
    return box_cloud((beside[0], beside[1]), (0.03, 0.03, beside[2] + 0.01))


@pytest.mark.parametrize("subgoal", [HANG, REORIENT], ids=str)
def test_a_plan_keeps_clear_of_what_stands_beside(subgoal: object) -> None:
    problem = mug_problem(find_subgoal(str(subgoal)), STANDING)
    alone = planned(problem)
    assert isinstance(alone, Plan), alone
    among = replace(problem, p_WObstacles=in_the_way(alone))
    checker = PlanChecker(problem.layout)
    found = checker.violations(alone, among)
    assert any("from another thing" in violation.what for violation in found)
    plan = planned(among)
    assert isinstance(plan, Plan), plan
    assert checker.violations(plan, among) == []


def test_neither_arm_nor_fingers_nor_what_is_held_may_touch_an_obstacle() -> None:
    q = configuration((0.5, 0.0, 0.2))
    world, X_WG = CollisionWorld(Layout()), gripper_pose(q)
    at_pad = transform_points(X_WG, np.array([[0.0, 0.045, 0.0]]))
    at_palm = transform_points(X_WG, np.array([[0.0, 0.0, -0.05]]))
    below = transform_points(X_WG, np.array([[0.0, 0.0, 0.08]]))
    for point in (at_pad, at_palm):
        among = world.among(point)
        assert not among.free(q[None], Situation(0.08))[0]
        assert not among.free(q[None], Situation(0.08, allowed=TOUCHING))[0], "it is no target"
    among = world.among(below)
    assert among.free(q[None], Situation(0.08))[0]
    assert not among.free(q[None], Situation(0.08, p_GHeld=np.array([[0.0, 0.0, 0.075]])))[0]
    assert world.free(q[None], Situation(0.08))[0], "the world that it came from has none"
    assert world.among(gripper_pose(Q_HOME)[None, :3, 3]).free(q[None], Situation(0.08))[0]


def test_a_plan_that_pairs_two_objects_is_refused() -> None:
    here = mug_problem(HANG, STANDING)
    X_WMoved = make_pose(p=(0.0, 0.16, 0.0))
    there = mug_problem(HANG, X_WMoved @ STANDING)
    plan = planned(here)
    assert isinstance(plan, Plan), plan
    both = replace(here, p_WPs=np.concatenate([here.p_WPs, there.p_WPs]))
    assert contract_violations(plan, both) == []
    paired = replace(plan, X_WObject=X_WMoved @ plan.X_WObject)
    whats = [violation.what for violation in contract_violations(paired, both)]
    assert "takes one object, and places a frame of another" in whats


def test_obstacles_are_points() -> None:
    with pytest.raises(ValueError, match=r"p_WObstacles has shape \(4, 2\); expected \(O, 3\)"):
        replace(mug_problem(HANG, STANDING), p_WObstacles=np.zeros((4, 2)))
