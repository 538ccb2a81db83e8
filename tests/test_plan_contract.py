"""Whether a plan does what its problem asks for: a good plan, spoilt in one way at a time."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers_planning import LYING, UPRIGHT, mug_problem

from planning.plan_contract import contract_violations
from planning.planner import make_planner
from planning.problem import JointTrajectory, Plan, PlanningProblem, Segment, SegmentName, Subgoal
from planning.timing import SAMPLE_S, rest
from planning.trajectory_check import TrajectoryChecker
from planning.waypoints import HANDLE_FLIP, place_grasp, shifted
from split_drake.layout import Layout
from split_drake.poses import make_pose, rotation_x

Spoil = Callable[[Plan], Plan]


def solved(subgoal: Subgoal, X_WO: np.ndarray) -> tuple[Plan, PlanningProblem]:
    problem = mug_problem(subgoal, X_WO)
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    return plan, problem


@pytest.fixture(scope="module")
def hang() -> tuple[Plan, PlanningProblem]:
    return solved(Subgoal.HANG, UPRIGHT)


@pytest.fixture(scope="module")
def reorient() -> tuple[Plan, PlanningProblem]:
    return solved(Subgoal.REORIENT, LYING)


def with_segment(plan: Plan, number: int, segment: Segment) -> Plan:
    return replace(plan, segments=(*plan.segments[:number], segment, *plan.segments[number + 1 :]))


def at_other_times(plan: Plan, number: int, step_s: float) -> Plan:
    old = plan.segments[number].trajectory
    moved = JointTrajectory(step_s * np.arange(len(old.times_s)), old.qs, old.vs)
    return with_segment(plan, number, replace(plan.segments[number], trajectory=moved))


def goal_moved(plan: Plan, X_Moved: np.ndarray) -> Plan:
    """Return the plan with another goal, and the release that brings the object there."""
    X_WGoal = plan.X_WGoal @ X_Moved
    X_WGplace = place_grasp(X_WGoal, plan.X_WObject, plan.X_WGrasp)
    return replace(plan, X_WGoal=X_WGoal, X_WGplace=X_WGplace)


def whats(plan: Plan, problem: PlanningProblem) -> str:
    return "; ".join(violation.what for violation in contract_violations(plan, problem))


def test_plans_of_the_default_planner_do_what_they_are_for(
    hang: tuple[Plan, PlanningProblem], reorient: tuple[Plan, PlanningProblem]
) -> None:
    assert contract_violations(*hang) == []
    assert contract_violations(*reorient) == []


def test_a_plan_for_an_object_in_the_hand_begins_with_the_transfer(
    hang: tuple[Plan, PlanningProblem],
) -> None:
    plan, problem = hang
    close = plan.segments[2].trajectory
    held = replace(problem, q_start=plan.place[0].trajectory.qs[0], held_width_m=0.02)
    placing = replace(plan, segments=plan.place)
    assert "begins with transit, where the object is in the hand" in whats(plan, held)
    assert "begins with transfer, where the object is on the table" in whats(placing, problem)
    # Lifted by the plan before, it lies elsewhere than where it was perceived.
    assert "X_WGrasp that is" in whats(placing, held)
    assert close.duration_s > 0.0


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (lambda p: replace(p, subgoal=Subgoal.REORIENT), "is to reorient, where the problem is"),
        (
            lambda p: replace(p, segments=p.segments[:2] + p.segments[3:]),
            "has the segments transit",
        ),
        (lambda p: replace(p, segments=p.segments[:5]), "see Plan for those expected"),
        (
            lambda p: with_segment(p, 4, replace(p.segments[4], holding=False)),
            "holds the object from lift to insert, but not so in transfer",
        ),
        (lambda p: replace(p, X_WGrasp=shifted(p.X_WGrasp, (0.0, 0.002, 0.0))), "an X_WGrasp that"),
        (lambda p: replace(p, X_WGoal=shifted(p.X_WGoal, (0.0, 0.0, 0.002))), "an X_WGoal that"),
        (
            lambda p: replace(p, X_WObject=shifted(p.X_WObject, (0.03, 0.0, 0.0))),
            "no handle pose of the problem is like",
        ),
        (lambda p: goal_moved(p, make_pose(p=(0.0, 0.05, 0.0))), "mm along the peg, 14.8 mm and"),
        (lambda p: goal_moved(p, make_pose(p=(0.04, 0.0, 0.0))), "mm and 0.0 deg off its axis"),
        (lambda p: goal_moved(p, make_pose(rotation_x(0.3))), "17.2 deg off its axis"),
        (lambda p: at_other_times(p, 0, 0.05), "has samples 50 ms apart; expected 10 ms"),
    ],
)
def test_a_plan_to_hang_that_is_spoilt(
    spoil: Spoil, what: str, hang: tuple[Plan, PlanningProblem]
) -> None:
    plan, problem = hang
    assert what in whats(spoil(plan), problem)


def test_a_handle_may_be_placed_either_way_round(hang: tuple[Plan, PlanningProblem]) -> None:
    plan, problem = hang
    flips = {"X_WObject": plan.X_WObject @ HANDLE_FLIP, "X_WGoal": plan.X_WGoal @ HANDLE_FLIP}
    assert contract_violations(replace(plan, **flips), problem) == []


def test_a_goal_that_does_not_stand_is_none(reorient: tuple[Plan, PlanningProblem]) -> None:
    plan, problem = reorient
    tilted = goal_moved(plan, make_pose(rotation_x(0.2)))
    assert "above the table, tilted by 11 deg" in whats(tilted, problem)
    floating = goal_moved(plan, make_pose(p=(0.0, 0.0, 0.1)))
    assert "mm above the table, tilted by 0 deg" in whats(floating, problem)


def test_a_plan_begins_where_the_robot_is_and_closes_on_the_object(
    hang: tuple[Plan, PlanningProblem],
) -> None:
    plan, problem = hang
    elsewhere = replace(problem, q_start=problem.q_start + 0.1)
    assert "starts 0.1000 rad from q_start" in whats(plan, elsewhere)
    gone = replace(problem, p_WPs=problem.p_WPs + np.array([0.0, 0.5, 0.0]))
    assert "m from the nearest point of the object" in whats(plan, gone)


def test_what_is_executed_are_the_angles_and_not_the_velocities(
    hang: tuple[Plan, PlanningProblem],
) -> None:
    plan, problem = hang
    qs = plan.segments[0].trajectory.qs[[0, -1]]
    dash = JointTrajectory(np.array([0.0, SAMPLE_S]), qs, np.zeros((2, 7)))
    found = TrajectoryChecker(Layout()).violations(
        with_segment(plan, 0, replace(plan.segments[0], trajectory=dash)), problem.p_WPs[::40]
    )
    whats = "; ".join(violation.what for violation in found if violation.segment == 0)
    assert "rad/s; it can" in whats
    assert "rad/s off those at which its angles change" in whats


def test_the_range_of_a_joint_is_named() -> None:
    q = np.array([0.0, 0.0, 0.0, 0.2, 0.0, 1.5, 0.8])
    segment = Segment(SegmentName.TRANSFER, rest(q, 0.1), 0.0, 0.0, 20.0, holding=True)
    plan = Plan(Subgoal.HANG, (segment,), *np.eye(4)[None].repeat(4, axis=0))
    found = TrajectoryChecker(Layout()).violations(plan, np.array([[1.4, 0.0, 0.0]]))
    assert "leaves the range of joint 4 by 0.2698 rad" in found[0].what


def test_a_plan_without_a_transfer_has_no_place() -> None:
    transit = Segment(SegmentName.TRANSIT, rest(np.zeros(7), 0.1), 0.0, 0.0, 20.0, holding=False)
    plan = Plan(Subgoal.HANG, (transit,), *np.eye(4)[None].repeat(4, axis=0))
    with pytest.raises(ValueError, match=r"segments are \['transit'\]; expected transfer"):
        _ = plan.place
