"""Whether a plan does what its problem asks for: a good plan, spoilt in one way at a time."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planning.checking.plan_contract import contract_violations
from planning.checking.trajectory_check import TrajectoryChecker
from planning.geometry.waypoints import place_grasp, shifted
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.motion.timing import rest
from planning.planner import make_planner
from planning.problem import (
    SAMPLE_S,
    JointTrajectory,
    Plan,
    PlanningProblem,
    Segment,
    SegmentName,
)
from planning.subgoal import Subgoal
from split_drake.pose_task import HANDLE
from split_drake.poses import invert_pose, make_pose, rotation_x, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.layout import Layout
from tests.helpers.planning import LYING, STANDING, mug_problem

Spoil = Callable[[Plan], Plan]
ASIDE = make_pose(p=(0.0, 0.05, 0.0))
LAST = np.eye(7)[6]


def solved(subgoal: Subgoal, X_WO: np.ndarray) -> tuple[Plan, PlanningProblem]:
    problem = mug_problem(subgoal, X_WO)
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    return plan, problem


@pytest.fixture(scope="module")
def hang() -> tuple[Plan, PlanningProblem]:
    return solved(HANG, STANDING)


@pytest.fixture(scope="module")
def reorient() -> tuple[Plan, PlanningProblem]:
    return solved(REORIENT, LYING)


def with_segment(plan: Plan, number: int, segment: Segment) -> Plan:
    return replace(plan, segments=(*plan.segments[:number], segment, *plan.segments[number + 1 :]))


def at_other_times(plan: Plan, number: int, step_s: float) -> Plan:
    old = plan.segments[number].trajectory
    moved = JointTrajectory(old.times_s * (step_s / SAMPLE_S), old.qs, old.vs)
    return with_segment(plan, number, replace(plan.segments[number], trajectory=moved))


def goal_moved(plan: Plan, X_Moved: np.ndarray) -> Plan:
    """Return the plan with another goal, and the release that brings the object there."""
    X_WGoal = plan.X_WGoal @ X_Moved
    X_WGplace = place_grasp(X_WGoal, plan.X_WObject, plan.X_WGrasp)
    return replace(plan, X_WGoal=X_WGoal, X_WGplace=X_WGplace)


def at_goal(plan: Plan, p_KH_mm: tuple[float, float, float]) -> Plan:
    """Return the plan with its handle brought to another place, given in K and mm."""
    X_KH = invert_pose(Layout().X_WK) @ plan.X_WGoal
    X_KH[:3, 3] = 1e-3 * np.array(p_KH_mm)
    return goal_moved(plan, invert_pose(plan.X_WGoal) @ Layout().X_WK @ X_KH)


def turning(plan: Plan, number: int) -> Plan:
    """Return the plan with a segment at rest in which the last joint turns by 0.3 rad."""
    segment = plan.segments[number]
    qs = segment.trajectory.qs + np.outer(np.linspace(0.0, 0.3, len(segment.trajectory.qs)), LAST)
    moved = JointTrajectory(segment.trajectory.times_s, qs, segment.trajectory.vs)
    return with_segment(plan, number, replace(segment, trajectory=moved))


def whats(plan: Plan, problem: PlanningProblem) -> str:
    return "; ".join(violation.what for violation in contract_violations(plan, problem))


def test_plans_of_the_default_planner_do_what_they_are_for(
    hang: tuple[Plan, PlanningProblem], reorient: tuple[Plan, PlanningProblem]
) -> None:
    assert contract_violations(*hang) == []
    assert contract_violations(*reorient) == []


def test_an_object_in_the_hand_is_placed_from_there(hang: tuple[Plan, PlanningProblem]) -> None:
    plan, problem = hang
    lift = plan.pick[-1]
    q_lifted = lift.trajectory.qs[-1]
    X_WMoved = gripper_pose(q_lifted) @ invert_pose(plan.X_WGrasp)
    held = replace(
        problem,
        pose_sets={task: poses.moved(X_WMoved) for task, poses in problem.pose_sets.items()},
        p_WPs=transform_points(X_WMoved, problem.p_WPs),
        q_start=q_lifted,
        held_width_m=lift.held_width_m,
    )
    placing = make_planner("default").plan(held, np.random.default_rng(0))
    assert isinstance(placing, Plan)
    assert contract_violations(placing, held) == []
    assert "begins with transit, where the object is in the hand" in whats(plan, held)
    assert "begins with transfer, where the object is on the table" in whats(placing, problem)
    # The first plan's place, of an object that lies elsewhere in the hand by now.
    turned = replace(held, pose_sets={t: s.moved(ASIDE) for t, s in held.pose_sets.items()})
    assert "no handle pose of the problem is like" in whats(placing, turned)


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (lambda p: replace(p, subgoal=REORIENT), "is to reorient, where the problem is"),
        (
            lambda p: replace(p, segments=p.segments[:2] + p.segments[3:]),
            "has the segments transit",
        ),
        (lambda p: replace(p, segments=p.segments[:5]), "see Plan for those expected"),
        (
            lambda p: with_segment(p, 4, replace(p.segments[4], holding=False)),
            "has holding = False",
        ),
        (
            lambda p: with_segment(p, 2, replace(p.segments[2], opening_end_m=0.08)),
            "ends with an opening of 0.080 m",
        ),
        (lambda p: with_segment(p, 4, replace(p.segments[4], force_n=0.0)), "and 0 N around"),
        (
            lambda p: with_segment(p, 7, replace(p.segments[7], opening_end_m=0.0)),
            "opens to 0.000 m around",
        ),
        (
            lambda p: with_segment(p, 6, replace(p.segments[6], stop_on_contact=False)),
            "is the last and stops at no contact",
        ),
        (lambda p: turning(p, 2), "moves the arm by 0.3000 rad; expected rest"),
        (lambda p: replace(p, X_WGrasp=shifted(p.X_WGrasp, (0.0, 0.002, 0.0))), "an X_WGrasp that"),
        (lambda p: replace(p, X_WGoal=shifted(p.X_WGoal, (0.0, 0.0, 0.002))), "an X_WGoal that"),
        (
            lambda p: replace(p, X_WObject=shifted(p.X_WObject, (0.03, 0.0, 0.0))),
            "no handle pose of the problem is like",
        ),
        (lambda p: at_goal(p, (0.0, 45.0, 0.0)), "p_KH = (0, 45, 0) mm"),
        (lambda p: at_goal(p, (0.0, 32.0, 0.0)), "p_KH = (0, 32, 0) mm"),
        (lambda p: at_goal(p, (0.0, -75.0, 0.0)), "p_KH = (0, -75, 0) mm"),
        (lambda p: at_goal(p, (15.0, 0.0, 0.0)), "p_KH = (15, 0, 0) mm"),
        (lambda p: at_goal(p, (0.0, 0.0, 15.0)), "p_KH = (0, 0, 15) mm"),
        (lambda p: at_goal(p, (0.0, 0.0, -30.0)), "p_KH = (0, 0, -30) mm"),
        (lambda p: goal_moved(p, make_pose(rotation_x(0.3))), "17.2 deg off the peg's axis"),
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
    flip = HANDLE.symmetry.X_half_turn
    flipped = replace(plan, X_WObject=plan.X_WObject @ flip, X_WGoal=plan.X_WGoal @ flip)
    assert contract_violations(flipped, problem) == []


def test_a_goal_that_does_not_stand_is_none(reorient: tuple[Plan, PlanningProblem]) -> None:
    plan, problem = reorient
    tilted = goal_moved(plan, make_pose(rotation_x(0.2)))
    assert "above the table, tilted by 11 deg" in whats(tilted, problem)
    floating = goal_moved(plan, make_pose(p=(0.0, 0.0, 0.1)))
    assert "mm above the table, tilted by 0 deg" in whats(floating, problem)


def test_the_arm_leaves_what_it_stood_upright_and_may_stay_beside_what_it_hung(
    hang: tuple[Plan, PlanningProblem], reorient: tuple[Plan, PlanningProblem]
) -> None:
    for (plan, problem), expected in ((hang, False), (reorient, True)):
        segments = tuple(s for i, s in enumerate(plan.segments) if i < 9)
        assert segments[-1].name is SegmentName.RETREAT
        found = whats(replace(plan, segments=segments), problem)
        assert ("see Plan for those expected" in found) == expected


def test_a_plan_begins_where_the_robot_is_and_closes_on_the_object(
    hang: tuple[Plan, PlanningProblem],
) -> None:
    plan, problem = hang
    elsewhere = replace(problem, q_start=problem.q_start + 0.1)
    assert "starts 0.1000 rad from q_start" in whats(plan, elsewhere)
    gone = replace(problem, p_WPs=problem.p_WPs + np.array([0.0, 0.0, 0.2]))
    assert "no point of the object is between the pads" in whats(plan, gone)


def test_motions_that_no_arm_makes_are_named(hang: tuple[Plan, PlanningProblem]) -> None:
    plan, problem = hang
    qs = plan.segments[0].trajectory.qs[[0, -1]]
    dash = JointTrajectory(np.array([0.0, SAMPLE_S]), qs, np.zeros((2, 7)))
    found = TrajectoryChecker(Layout()).violations(
        with_segment(plan, 0, replace(plan.segments[0], trajectory=dash)), problem.p_WPs[::40]
    )
    whats = "; ".join(violation.what for violation in found if violation.segment == 0)
    assert "rad/s; at most" in whats
    assert "rad/s^2; at most" in whats
    assert "rad/s off those at which its angles change" in whats


def test_the_range_of_a_joint_is_named() -> None:
    q = np.array([0.0, 0.0, 0.0, 0.2, 0.0, 1.5, 0.8])
    segment = Segment(SegmentName.TRANSFER, rest(q, 0.1), 0.0, 0.0, 20.0, holding=True)
    plan = Plan(HANG, (segment,), *np.eye(4)[None].repeat(4, axis=0))
    found = TrajectoryChecker(Layout()).violations(plan, np.array([[1.4, 0.0, 0.0]]))
    assert "leaves the range of joint 4 by 0.2698 rad" in found[0].what


def test_a_plan_without_a_transfer_has_no_place() -> None:
    transit = Segment(SegmentName.TRANSIT, rest(np.zeros(7), 0.1), 0.0, 0.0, 20.0, holding=False)
    plan = Plan(HANG, (transit,), *np.eye(4)[None].repeat(4, axis=0))
    with pytest.raises(ValueError, match=r"segments are \['transit'\]; expected transfer"):
        _ = plan.place
