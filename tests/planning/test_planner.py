"""The default planner: plans pass the independent check, are reproducible, and failures explain."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from planning.checking.trajectory_check import TrajectoryChecker
from planning.geometry.perceived import PerceivedObject, revolved_body, voxel_centroids
from planning.goals.hang import STILL_AFTER_S, freest_axis
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.motion.segment_builder import executed_s
from planning.motion.timing import rest
from planning.pick_place.segments import moves_after, shortened
from planning.planner import Planner, make_planner, planner_names, register_planner
from planning.problem import Plan, PlanFailure, PlanningProblem, SegmentName, Stage
from planning.subgoal import AllowedContact
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, PoseTask
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.scene import Workspace
from split_drake.station.layout import HookShape, Layout, same_fixtures
from tests.helpers.planning import LYING, RADIUS_M, STANDING, WALL_M, mug_cloud, mug_problem

CASES = {
    "hang": (HANG, STANDING),
    "reorient": (REORIENT, LYING),
}


@cache
def planner() -> Planner:
    return make_planner("default")


@cache
def plan_for(case: str, seed: int = 0) -> Plan:
    plan = planner().plan(mug_problem(*CASES[case]), np.random.default_rng(seed))
    assert isinstance(plan, Plan), plan
    return plan


def obstacles(X_WO: Array) -> Array:
    return voxel_centroids(transform_points(X_WO, mug_cloud()), 0.010)


@pytest.mark.parametrize("case", CASES)
def test_plans_pass_the_independent_check(case: str) -> None:
    checker = TrajectoryChecker(Layout())
    assert checker.violations(plan_for(case), obstacles(CASES[case][1])) == []


@pytest.mark.parametrize("case", CASES)
def test_segments_come_in_order_and_join(case: str) -> None:
    names = [segment.name for segment in plan_for(case).segments]
    order = list(dict.fromkeys(names))
    of_recovery = (SegmentName.BACK_OUT, SegmentName.EASE)
    assert order == [name for name in SegmentName if name not in of_recovery]
    for before, after in pairwise(plan_for(case).segments):
        np.testing.assert_allclose(before.trajectory.qs[-1], after.trajectory.qs[0], atol=1e-6)


def test_contacts_are_declared_where_they_belong_and_nowhere_else() -> None:
    expected = {
        SegmentName.TRANSIT: set(),
        SegmentName.APPROACH: {AllowedContact.FINGERS_TARGET},
        SegmentName.CLOSE: {AllowedContact.FINGERS_TARGET},
        SegmentName.LIFT: {AllowedContact.HELD_TABLE},
        SegmentName.TRANSFER: set(),
        SegmentName.INSERT: {AllowedContact.HELD_PEG},
        SegmentName.OPEN: {AllowedContact.FINGERS_TARGET, AllowedContact.HELD_PEG},
        SegmentName.RETREAT: {AllowedContact.FINGERS_TARGET},
    }
    for segment in plan_for("hang").segments:
        assert set(segment.allowed_contacts) == expected[segment.name], segment.name


def test_goals_agree_with_the_gripper() -> None:
    for case in CASES:
        plan = plan_for(case)
        X_GObject = np.linalg.solve(plan.X_WGrasp, plan.X_WObject)
        np.testing.assert_allclose(plan.X_WGplace @ X_GObject, plan.X_WGoal, atol=1e-9)
        at_open = next(s for s in plan.segments if s.name is SegmentName.OPEN).trajectory.qs[0]
        np.testing.assert_allclose(gripper_pose(at_open), plan.X_WGplace, atol=1e-5)
        at_close = next(s for s in plan.segments if s.name is SegmentName.CLOSE).trajectory.qs[0]
        np.testing.assert_allclose(gripper_pose(at_close), plan.X_WGrasp, atol=1e-5)


def test_the_same_seed_gives_the_same_plan() -> None:
    again = make_planner("default").plan(mug_problem(*CASES["reorient"]), np.random.default_rng(0))
    assert isinstance(again, Plan)
    for one, other in zip(plan_for("reorient").segments, again.segments, strict=True):
        np.testing.assert_array_equal(one.trajectory.qs, other.trajectory.qs)


def without(problem: PlanningProblem, task: PoseTask) -> PlanningProblem:
    empty = PoseSet(task, np.empty((0, 4, 4)), np.empty(0))
    return replace(problem, pose_sets={**problem.pose_sets, task.name: empty})


@pytest.mark.parametrize("task", [GRASP, HANDLE])
def test_empty_pose_sets_are_failures_of_perception(task: PoseTask) -> None:
    problem = without(mug_problem(HANG, STANDING), task)
    failure = planner().plan(problem, np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert failure.stage is Stage.PERCEPTION
    assert task.name in failure.reason or "goal" in failure.reason


def test_an_unreachable_object_is_rejected_by_ik() -> None:
    beyond = make_pose(p=(1.05, 0.0, 0.0))
    failure = planner().plan(mug_problem(HANG, beyond), np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert failure.stage is Stage.PLANNING
    assert failure.reason.startswith("0 of") and "IK" in failure.reason


def test_a_walled_in_object_is_rejected_by_collisions() -> None:
    problem = mug_problem(HANG, STANDING)
    lid = np.stack(np.meshgrid(np.arange(0.3, 0.7, 0.01), np.arange(-0.2, 0.2, 0.01), 0.16), -1)
    covered = np.concatenate([problem.p_WPs, lid.reshape(-1, 3)])
    failure = planner().plan(replace(problem, p_WPs=covered), np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert "0 of" in failure.reason
    assert "collision" in failure.reason or "clears" in failure.reason


def test_a_handle_whose_opening_is_filled_is_no_goal() -> None:
    problem = mug_problem(HANG, STANDING)
    X_WH = problem.pose_sets["handle"].X_WPs[0]
    x, z = np.meshgrid(*2 * [np.linspace(-0.02, 0.02, 9)])
    plug = transform_points(X_WH, np.column_stack([x.ravel(), 0.0 * x.ravel(), z.ravel()]))
    assert freest_axis(X_WH, problem.p_WPs)[1] > Layout().hook.peg_radius_m
    assert freest_axis(X_WH, plug)[1] < Layout().hook.peg_radius_m
    filled = replace(problem, p_WPs=np.concatenate([problem.p_WPs, plug]))
    failure = planner().plan(filled, np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert "goal" in failure.reason


def test_the_insertion_before_the_felt_lowering_stays_clear_of_the_table() -> None:
    for segment in plan_for("reorient").segments:
        if segment.name is SegmentName.INSERT:
            expected = {AllowedContact.HELD_TABLE} if segment.stop_on_contact else set()
            assert set(segment.allowed_contacts) == expected


def test_carrying_is_planned_with_the_width_of_what_is_held() -> None:
    for segment in plan_for("hang").segments:
        if segment.holding:
            nearest = min((WALL_M, 2.0 * RADIUS_M), key=lambda w: abs(w - segment.held_width_m))
            assert segment.held_width_m == pytest.approx(nearest, abs=0.003)
            assert segment.openings_m == (segment.held_width_m,) * 2


def test_after_hanging_the_arm_rests_before_the_verdict() -> None:
    segments = plan_for("hang").segments
    names = [segment.name for segment in segments]
    after = segments[names.index(SegmentName.OPEN) + 1 :]
    assert sum(executed_s(segment) for segment in after) < 2.9


def test_a_withdrawal_that_lasts_too_long_is_dropped() -> None:
    segments = plan_for("hang").segments
    names = [segment.name for segment in segments]
    released = segments[: names.index(SegmentName.RETREAT) + 1]
    retreat_s = executed_s(released[-1])
    for sum_s, expected in ((2.85, True), (2.95, False)):
        trajectory = rest(released[-1].trajectory.qs[-1], sum_s - retreat_s)
        withdrawal = replace(released[-1], name=SegmentName.TRANSIT, trajectory=trajectory)
        kept = shortened((*released, withdrawal), STILL_AFTER_S)
        assert (len(kept) == len(released) + 1) is expected
        assert not moves_after(kept, STILL_AFTER_S)
    endless = replace(released[-1], trajectory=rest(released[-1].trajectory.qs[-1], 3.0))
    assert moves_after((*released[:-1], endless), STILL_AFTER_S)


def test_the_world_is_kept_while_the_fixtures_are_the_same() -> None:
    assert same_fixtures(Layout(), Layout())
    raised = Layout(X_WK=Layout().X_WK @ make_pose(p=(0.0, 0.0, 0.01)))
    thick = Layout(hook=HookShape(peg_radius_m=0.008))
    high = Layout(workspace=Workspace(p_WCenter=(0.5, 0.0, 0.1)))
    for other in (raised, thick, Layout(p_WTable=(0.5, 0.0)), high):
        assert not same_fixtures(Layout(), other)


def test_unknown_planners_are_errors_that_name_the_known() -> None:
    assert "default" in planner_names()
    with pytest.raises(ValueError, match="default"):
        make_planner("fancy")
    with pytest.raises(ValueError, match="registered already"):
        register_planner("default")(planner)


def test_a_half_seen_body_is_completed_without_the_handle() -> None:
    X_WU = STANDING
    p_UPs = mug_cloud()
    seen = transform_points(X_WU, p_UPs[p_UPs[:, 1] > 0.0])
    completed = transform_points(np.linalg.inv(X_WU), revolved_body(seen, X_WU))
    assert np.hypot(completed[:, 0], completed[:, 1]).max() < 0.035
    hidden = p_UPs[(p_UPs[:, 1] < -0.01) & (np.hypot(p_UPs[:, 0], p_UPs[:, 1]) < 0.035)]
    gaps = np.linalg.norm(hidden[:, None] - completed[None], axis=-1).min(axis=1)
    assert gaps.max() < 0.012


def test_an_empty_cloud_is_an_error() -> None:
    with pytest.raises(ValueError, match="empty"):
        PerceivedObject.from_cloud(np.empty((0, 3)), None, 0.0)
