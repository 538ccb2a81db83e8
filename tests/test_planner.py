"""The default planner: plans pass the independent check, are reproducible, and failures explain."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from helpers_planning import LYING, UPRIGHT, mug_cloud, mug_problem

from planning.candidates import BestPairs, distinct_modes
from planning.perceived import PerceivedObject, revolved_body, voxel_centroids
from planning.placements import axis_clearance
from planning.planner import Planner, make_planner, planner_names, register_planner
from planning.problem import (
    AllowedContact,
    Plan,
    PlanFailure,
    PlanningProblem,
    SegmentName,
    Stage,
    Subgoal,
)
from planning.trajectory_check import TrajectoryChecker
from split_drake.layout import Layout
from split_drake.pose_set import PoseSet, PoseTask
from split_drake.poses import Array, make_pose, transform_points

CASES = {
    "hang": (Subgoal.HANG, UPRIGHT),
    "reorient": (Subgoal.REORIENT, LYING),
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
    assert order == list(SegmentName)
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


def test_the_same_seed_gives_the_same_plan() -> None:
    again = make_planner("default").plan(mug_problem(*CASES["reorient"]), np.random.default_rng(0))
    assert isinstance(again, Plan)
    for one, other in zip(plan_for("reorient").segments, again.segments, strict=True):
        np.testing.assert_array_equal(one.trajectory.qs, other.trajectory.qs)


def without(problem: PlanningProblem, task: PoseTask) -> PlanningProblem:
    empty = PoseSet(task, np.empty((0, 4, 4)), np.empty(0))
    return replace(problem, pose_sets={**problem.pose_sets, task: empty})


@pytest.mark.parametrize("task", [PoseTask.GRASP, PoseTask.HANDLE])
def test_empty_pose_sets_are_failures_of_perception(task: PoseTask) -> None:
    problem = without(mug_problem(Subgoal.HANG, UPRIGHT), task)
    failure = planner().plan(problem, np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert failure.stage is Stage.PERCEPTION
    assert task.value in failure.reason or "goal" in failure.reason


def test_an_unreachable_object_is_rejected_by_ik() -> None:
    far = make_pose(p=(1.4, 0.0, 0.0))
    failure = planner().plan(mug_problem(Subgoal.HANG, far), np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert failure.stage is Stage.PLANNING
    assert failure.reason.startswith("0 of") and "IK" in failure.reason


def test_a_walled_in_object_is_rejected_by_collisions() -> None:
    problem = mug_problem(Subgoal.HANG, UPRIGHT)
    lid = np.stack(np.meshgrid(np.arange(0.3, 0.7, 0.01), np.arange(-0.2, 0.2, 0.01), 0.16), -1)
    covered = np.concatenate([problem.p_WPs, lid.reshape(-1, 3)])
    failure = planner().plan(replace(problem, p_WPs=covered), np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert "0 of" in failure.reason
    assert "collision" in failure.reason or "clears" in failure.reason


def test_a_handle_whose_opening_is_filled_is_no_goal() -> None:
    problem = mug_problem(Subgoal.HANG, UPRIGHT)
    X_WH = problem.pose_sets[PoseTask.HANDLE].X_WPs[0]
    plug = X_WH[:3, 3] + np.linspace(-0.01, 0.01, 9)[:, None] * X_WH[:3, 1]
    assert axis_clearance(X_WH, problem.p_WPs) > 0.005
    assert axis_clearance(X_WH, plug) < 1e-6
    filled = replace(problem, p_WPs=np.concatenate([problem.p_WPs, plug]))
    failure = planner().plan(filled, np.random.default_rng(0))
    assert isinstance(failure, PlanFailure)
    assert "goal" in failure.reason


def test_unknown_planners_are_errors_that_name_the_known() -> None:
    assert "default" in planner_names()
    with pytest.raises(ValueError, match="default"):
        make_planner("fancy")
    with pytest.raises(ValueError, match="registered already"):
        register_planner("default")(planner)


def test_pairs_come_best_first_and_whole_rows_can_be_dropped() -> None:
    pairs = BestPairs([0.5, 1.0], [0.2, 0.9, 0.5])
    everything = list(pairs)
    products = [[0.5, 1.0][row] * [0.2, 0.9, 0.5][column] for row, column in everything]
    assert products == sorted(products, reverse=True)
    assert len(set(everything)) == 6
    pairs = BestPairs([0.5, 1.0], [0.2, 0.9, 0.5])
    kept = []
    for row, column in pairs:
        kept.append((row, column))
        if row == 1:
            pairs.drop_row(1)
    assert [row for row, _ in kept].count(1) == 1
    assert list(BestPairs([1.0], [])) == []


def test_modes_are_apart() -> None:
    near, far = make_pose(p=(0.001, 0.0, 0.0)), make_pose(p=(0.1, 0.0, 0.0))
    assert distinct_modes(np.stack([np.eye(4), near, far]), 3) == [0, 2]
    assert distinct_modes(np.stack([np.eye(4), near, far]), 1) == [0]


def test_a_half_seen_body_is_completed_without_the_handle() -> None:
    X_WU = UPRIGHT
    p_UPs = mug_cloud()
    seen = transform_points(X_WU, p_UPs[p_UPs[:, 1] > 0.0])
    completed = transform_points(np.linalg.inv(X_WU), revolved_body(seen, X_WU))
    assert np.hypot(completed[:, 0], completed[:, 1]).max() < 0.035
    hidden = p_UPs[(p_UPs[:, 1] < -0.01) & (np.hypot(p_UPs[:, 0], p_UPs[:, 1]) < 0.035)]
    gaps = np.linalg.norm(hidden[:, None] - completed[None], axis=-1).min(axis=1)
    assert gaps.max() < 0.012


def test_an_empty_cloud_is_an_error() -> None:
    with pytest.raises(ValueError, match="empty"):
        PerceivedObject.from_cloud(np.empty((0, 3)), None)
