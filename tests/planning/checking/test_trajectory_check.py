"""The independent check sees what is wrong with a plan, and honours declared contacts alone."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planning.checking.checked_planner import CheckedPlanner
from planning.checking.trajectory_check import STEP_RAD, TrajectoryChecker, fine_steps
from planning.collision.exemptions import MAX_TABLE_DEPTH_M, TABLE_LIFT_M
from planning.geometry.perceived import voxel_centroids
from planning.goals.hang import SUBGOAL as HANG
from planning.motion.ik import solve_ik
from planning.motion.timing import rest
from planning.pick_place.pick import Q_COMFORT
from planning.problem import (
    JointTrajectory,
    Plan,
    PlanFailure,
    PlanningProblem,
    Segment,
    SegmentName,
    Stage,
)
from planning.subgoal import AllowedContact
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PALM
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.layout import Layout
from tests.helpers.planning import STANDING, hang_plan, mug_cloud, mug_problem, reorient_plan


@cache
def checker() -> TrajectoryChecker:
    return TrajectoryChecker(Layout())


@cache
def cloud() -> Array:
    return voxel_centroids(transform_points(STANDING, mug_cloud()), 0.012)


def changed(name: SegmentName, change: Callable[[Segment], Segment]) -> Plan:
    """Return the plan with all segments of a name changed."""
    segments = tuple(
        change(segment) if segment.name is name else segment for segment in hang_plan().segments
    )
    return replace(hang_plan(), segments=segments)


def without_contacts(segment: Segment) -> Segment:
    return replace(segment, allowed_contacts=frozenset())


def driven(trajectory: JointTrajectory) -> Callable[[Segment], Segment]:
    """Return what gives segments another trajectory."""
    return lambda segment: replace(segment, trajectory=trajectory)


def names(plan: Plan, points: Array) -> set[str]:
    return {violation.name for violation in checker().violations(plan, points)}


def segment(name: SegmentName) -> Segment:
    return next(s for s in hang_plan().segments if s.name is name)


def test_the_plan_as_it_is_has_no_violations() -> None:
    assert checker().violations(hang_plan(), cloud()) == []


@pytest.mark.parametrize(
    "name", [SegmentName.CLOSE, SegmentName.LIFT, SegmentName.INSERT, SegmentName.OPEN]
)
def test_without_its_declared_contacts_a_segment_is_wrong(name: SegmentName) -> None:
    assert names(changed(name, without_contacts), cloud()) == {name.value}


def test_an_obstacle_moved_into_the_way_is_found() -> None:
    lift = segment(SegmentName.LIFT).trajectory.qs[0]
    wrist = gripper_pose(lift) @ np.array([0.0, 0.0, -0.15, 1.0])
    found = names(hang_plan(), np.concatenate([cloud(), wrist[None, :3]]))
    assert SegmentName.APPROACH.value in found


def test_what_touches_the_palm_of_a_hand_that_holds_it_may_go_on_doing_so() -> None:
    begins = gripper_pose(segment(SegmentName.TRANSFER).trajectory.qs[0])
    lifted = begins @ invert_pose(hang_plan().X_WGrasp)
    held_plan = replace(
        hang_plan(), segments=hang_plan().place, X_WObject=lifted @ hang_plan().X_WObject
    )
    held = transform_points(lifted, cloud())
    at_palm = transform_points(begins, np.array([[0.0, 0.0, PALM.upper[2] + 0.002]]))
    assert names(held_plan, held) == set()
    assert names(held_plan, np.concatenate([held, at_palm])) == set()
    picked = transform_points(hang_plan().X_WGrasp, np.array([[0.0, 0.0, PALM.upper[2] + 0.002]]))
    assert names(hang_plan(), np.concatenate([cloud(), picked]))


def test_held_points_outside_the_tube_may_not_touch_the_peg() -> None:
    beside_the_opening = np.array([[0.0, 0.045, 0.0], [0.0, -0.045, 0.0]])
    plug = transform_points(hang_plan().X_WObject, beside_the_opening)
    assert SegmentName.INSERT.value in names(hang_plan(), np.concatenate([cloud(), plug]))


def test_the_table_may_be_touched_by_the_object_only_where_declared() -> None:
    lifting = driven(segment(SegmentName.LIFT).trajectory)
    transfer = changed(SegmentName.TRANSFER, lifting)
    found = checker().violations(transfer, cloud())
    assert any(v.name == "transfer" and "table" in v.what for v in found)


def test_the_table_may_be_touched_only_lightly() -> None:
    carrying = tuple(s for s in reorient_plan().segments if s.holding)
    plan = replace(reorient_plan(), segments=carrying)
    for depth_m in (1.2 * MAX_TABLE_DEPTH_M, 0.9 * Layout().table_size_m[2]):
        below = STANDING[:3, 3] - (0.0, 0.0, depth_m)
        found = checker().violations(plan, below[None])
        assert [v.name for v in found if "table" in v.what][-1] == SegmentName.INSERT


def test_the_table_may_not_be_touched_by_a_motion_that_does_not_feel_it() -> None:
    unfelt = tuple(replace(s, stop_on_contact=False) for s in reorient_plan().segments)
    found = checker().violations(replace(reorient_plan(), segments=unfelt), cloud())
    assert {v.name for v in found} == {SegmentName.INSERT}
    assert any("held_table is declared" in v.what for v in found)


def test_the_table_may_not_be_touched_once_the_object_is_lifted() -> None:
    for depth_m, expected in ((0.010, set()), (TABLE_LIFT_M - 0.001, {SegmentName.LIFT.value})):
        below = STANDING[:3, 3] - (0.0, 0.0, depth_m)
        assert names(hang_plan(), np.concatenate([cloud(), below[None]])) == expected


def test_the_peg_may_not_pass_through_what_bounds_the_opening() -> None:
    on_axis = transform_points(hang_plan().X_WObject, np.array([[0.0, 0.0, 0.0]]))
    found = checker().violations(hang_plan(), np.concatenate([cloud(), on_axis]))
    assert {v.name for v in found} == {SegmentName.INSERT.value}


@pytest.mark.parametrize(("width_m", "overlaps"), [(0.004, False), (MAX_OPENING_M, True)])
def test_fingers_are_checked_where_the_held_object_stops_them(
    width_m: float, overlaps: bool
) -> None:
    X_WK = Layout().X_WK
    across_peg = np.column_stack([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    beside_peg = make_pose(across_peg, X_WK[:3, 3] - (MAX_OPENING_M / 2.0 + 0.007, 0.0, 0.0))
    there = rest(solve_ik(beside_peg[None]).of(0, Q_COMFORT)[0], 0.02)
    plan = changed(
        SegmentName.TRANSFER, lambda s: replace(s, trajectory=there, held_width_m=width_m)
    )
    found = checker().violations(plan, cloud())
    fingers = [v for v in found if v.name == "transfer" and "finger" in v.what]
    assert bool(fingers) is overlaps


def test_jumps_limits_and_missing_rest_are_found() -> None:
    transit = segment(SegmentName.TRANSIT).trajectory
    jump = replace(transit, qs=transit.qs + 0.01)
    fast = replace(transit, vs=transit.vs * 10.0)
    moving = replace(transit, vs=transit.vs + 0.1)
    for trajectory, word in ((jump, "starts"), (fast, "rad/s"), (moving, "rest")):
        found = checker().violations(changed(SegmentName.TRANSIT, driven(trajectory)), cloud())
        assert any(word in violation.what for violation in found), word


def test_fingers_may_be_exempt_only_near_the_object() -> None:
    touching = frozenset({AllowedContact.FINGERS_TARGET})
    everywhere = changed(SegmentName.TRANSIT, lambda s: replace(s, allowed_contacts=touching))
    found = checker().violations(everywhere, cloud())
    assert any("fingers_target" in violation.what for violation in found)


def test_steps_are_fine_and_reach_every_sample() -> None:
    qs = segment(SegmentName.TRANSIT).trajectory.qs
    fine = np.stack(list(fine_steps(qs)))
    assert np.abs(np.diff(fine, axis=0)).max() <= STEP_RAD + 1e-12
    np.testing.assert_allclose(fine[-1], qs[-1], atol=1e-6)


class _Answers:
    """A planner that gives the answers that it was made with, in turn."""

    def __init__(self, *answers: Plan | PlanFailure) -> None:
        self._answers = iter(answers)

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        return next(self._answers)


def test_a_checked_planner_passes_on_what_is_sound_and_refuses_the_rest() -> None:
    broken = changed(SegmentName.CLOSE, without_contacts)
    sound = (hang_plan(), PlanFailure(Stage.PLANNING, "no way"))
    planner, rng = CheckedPlanner(_Answers(*sound, broken)), np.random.default_rng(0)
    problem = mug_problem(HANG, STANDING)
    assert [planner.plan(problem, rng) for _ in sound] == list(sound)
    assert planner.violations == []
    refused = planner.plan(problem, rng)
    assert planner.violations[0].name == SegmentName.CLOSE
    assert refused == PlanFailure(Stage.CHECK, str(planner.violations[0]), broken.statistics)


def jumping(segment: Segment) -> Segment:
    """Turn the last joint by 2 rad from one sample to the next, and stay there."""
    qs = segment.trajectory.qs.copy()
    qs[len(qs) // 2 :, 6] += 2.0
    return replace(segment, trajectory=replace(segment.trajectory, qs=qs))


def out_of_range(segment: Segment) -> Segment:
    """Bend the elbow to where no elbow goes, and back."""
    qs = segment.trajectory.qs.copy()
    qs[1:-1, 3] += 3.0
    return replace(segment, trajectory=replace(segment.trajectory, qs=qs))


@pytest.mark.parametrize("change", [jumping, out_of_range])
def test_plans_that_no_arm_can_follow_are_refused(change: Callable[[Segment], Segment]) -> None:
    broken = changed(SegmentName.TRANSFER, change)
    planner = CheckedPlanner(_Answers(broken))
    refused = planner.plan(mug_problem(HANG, STANDING), np.random.default_rng(0))
    assert isinstance(refused, PlanFailure)
    assert refused.stage is Stage.CHECK
    assert "transfer" in refused.reason
