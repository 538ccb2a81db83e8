"""Grasps turned about a mug's axis hold it as those that were detected do."""

from dataclasses import replace

import numpy as np
import pytest

from planning.geometry.perceived import PerceivedObject
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.pick_place.fingers import fit_fingers, settled
from planning.pick_place.turned_grasps import TURNED, turned_grasps
from planning.planner import make_planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage
from planning.subgoal import Subgoal
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array, invert_pose, make_pose, rotation_error_rad, transform_points
from split_drake.robot.open_hand import lowest_heights
from tests.helpers.planning import LYING, STANDING, mug_problem, rim_grasps


def grasp_set(X_WGs: Array) -> PoseSet:
    return PoseSet(GRASP, X_WGs, np.linspace(1.0, 0.9, len(X_WGs)))


def turned_of(X_WGs: Array) -> PoseSet:
    """Return the turned grasps of a mug that stands."""
    surface = PerceivedObject.from_cloud(mug_problem(HANG, STANDING).p_WPs, STANDING, 0.0)
    return turned_grasps(grasp_set(X_WGs), STANDING, surface.p_WSurface, 0.0)


def test_turned_grasps_are_as_far_from_the_axis_and_as_high_on_it() -> None:
    X_OG = rim_grasps()[0]
    turned = turned_of(STANDING @ X_OG[None])
    p_OGs = (invert_pose(STANDING) @ turned.X_WPs)[:, :3, 3]
    np.testing.assert_allclose(np.hypot(*p_OGs[:, :2].T), np.hypot(*X_OG[:2, 3]))
    np.testing.assert_allclose(p_OGs[:, 2], X_OG[2, 3])
    angles = np.unique(np.round(np.degrees(np.arctan2(p_OGs[:, 1], p_OGs[:, 0])), 3))
    assert len(angles) > 6
    assert (np.diff(turned.scores) <= 0.0).all()


def test_grasps_that_were_detected_come_before_turned_ones() -> None:
    detected = STANDING @ rim_grasps()[:1]
    turned = turned_of(detected)
    np.testing.assert_allclose(turned.X_WPs[0], detected[0], atol=1e-9)
    assert turned.scores[0] == 1.0 and turned.scores[1] <= TURNED


def test_turned_grasps_pinch_the_wall_as_deeply() -> None:
    problem = mug_problem(HANG, STANDING)
    detected = STANDING @ rim_grasps()[:1]
    turned = turned_of(detected)
    upright = rotation_error_rad(turned.X_WPs[:, :3, :3], detected[0, :3, :3]) > 0.1
    plain = [X for X in turned.X_WPs[upright] if X[2, 2] < -0.99]
    assert len(plain) > 3
    depths = [fit_fingers(X_WG, problem.p_WPs).pinch_depth_m for X_WG in plain]
    expected = fit_fingers(detected[0], problem.p_WPs).pinch_depth_m
    assert np.median(depths) == pytest.approx(expected, abs=0.002)


def test_grasps_that_no_arm_reaches_are_left_out() -> None:
    far = make_pose(p=(3.0, 0.0, 0.0)) @ STANDING
    surface = transform_points(make_pose(p=(3.0, 0.0, 0.0)), mug_problem(HANG, STANDING).p_WPs)
    assert len(turned_grasps(grasp_set(far @ rim_grasps()), far, surface, 0.0)) == 0


def test_turned_grasps_stay_above_the_table_and_pinch_what_is_there() -> None:
    problem = mug_problem(HANG, LYING)
    surface = PerceivedObject.from_cloud(problem.p_WPs, LYING, 0.0).p_WSurface
    turned = turned_grasps(grasp_set(LYING @ rim_grasps()), LYING, surface, 0.0)
    assert len(turned) > 20
    assert lowest_heights(turned.X_WPs).min() > 0.0
    fits = [fit_fingers(settled(X_WG, surface), surface) for X_WG in turned.X_WPs]
    assert all(fit.clears and fit.pinches for fit in fits)
    # A table that is higher leaves fewer.
    assert len(turned_grasps(grasp_set(LYING @ rim_grasps()), LYING, surface, 0.03)) < len(turned)


def from_below(subgoal: Subgoal) -> PlanningProblem:
    """Return a lying mug's problem whose grasps all come from below the table."""
    known = mug_problem(subgoal, LYING)
    below = LYING @ rim_grasps()
    below = below[below[:, 2, 2] > 0.3]
    assert len(below)
    return replace(known, pose_sets={**known.pose_sets, "grasp": grasp_set(below)})


def test_a_plan_is_found_where_all_detected_grasps_are_out_of_reach() -> None:
    problem = from_below(REORIENT)
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    assert problem.pose_sets["grasp"].X_WPs[:, 2, 2].min() > 0.3 > plan.X_WGrasp[2, 2]


def test_without_an_upright_pose_nothing_is_turned() -> None:
    problem = from_below(HANG)
    pose_sets = {name: s for name, s in problem.pose_sets.items() if name != "upright"}
    unknown = replace(problem, pose_sets=pose_sets)
    outcome = make_planner("default").plan(unknown, np.random.default_rng(0))
    assert isinstance(outcome, PlanFailure) and outcome.stage is Stage.PLANNING
    assert "turned" not in outcome.reason
