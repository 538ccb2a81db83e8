"""Plans that take something off a cluttered table and drop it into a bin."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planning.clearing.drop_plan import DropPlan, DropProblem
from planning.clearing.drop_planner import ABOVE_RIM_M, DropPlanner
from planning.execution.executor import CONTACT_AFTER_S
from planning.problem import PlanFailure, SegmentName, Stage
from planning.subgoal import AllowedContact
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import invert_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout, OpenBin
from tests.helpers.clutter import box_cloud, grasp_from_above, grasps

LAYOUT = replace(Layout(), bin=OpenBin())
ONE = box_cloud((0.5, 0.0), (0.04, 0.04, 0.06))
OTHER = box_cloud((0.5, 0.14), (0.04, 0.04, 0.14))
ABOVE_ONE = grasp_from_above((0.5, 0.0, 0.045))
IN_THE_AIR = grasp_from_above((0.45, -0.1, 0.2))
IN_THE_TABLE = grasp_from_above((0.5, 0.0, 0.003))


@cache
def planner() -> DropPlanner:
    return DropPlanner()


def planned(found: PoseSet, order: tuple[int, ...] = ()) -> DropPlan | PlanFailure:
    problem = DropProblem(found, np.concatenate([ONE, OTHER]), Q_HOME, LAYOUT, order)
    return planner().plan(problem, np.random.default_rng(0))


@cache
def plan() -> DropPlan:
    found = planned(grasps(ABOVE_ONE))
    assert isinstance(found, DropPlan)
    return found


def test_the_segments_join_from_home_to_home() -> None:
    segments = plan().segments
    assert [segment.name for segment in segments] == [
        SegmentName.TRANSIT,
        SegmentName.APPROACH,
        SegmentName.CLOSE,
        SegmentName.LIFT,
        SegmentName.TRANSFER,
        SegmentName.OPEN,
        SegmentName.TRANSIT,
    ]
    at = Q_HOME
    for segment in segments:
        np.testing.assert_allclose(segment.trajectory.qs[0], at, atol=1e-6)
        at = segment.trajectory.qs[-1]
    np.testing.assert_allclose(at, Q_HOME, atol=1e-6)


def test_the_hand_closes_where_the_grasp_is_and_opens_above_the_bin() -> None:
    by_name = {segment.name: segment for segment in plan().segments}
    X_WClose = gripper_pose(by_name[SegmentName.CLOSE].trajectory.qs[0])
    np.testing.assert_allclose(X_WClose, plan().X_WG, atol=1e-5)
    assert GRASP.symmetry.rotation_error_rad(X_WClose[:3, :3], ABOVE_ONE[:3, :3]) < 1e-4
    X_WOpen = gripper_pose(by_name[SegmentName.OPEN].trajectory.qs[0])
    released = transform_points(X_WOpen @ invert_pose(X_WClose), ONE)
    rim = np.array(OpenBin().p_WRim)
    assert np.abs(released[:, :2].mean(axis=0) - rim[:2]).max() < 0.03
    assert released[:, 2].min() - rim[2] == pytest.approx(ABOVE_RIM_M, abs=0.005)
    assert by_name[SegmentName.OPEN].opening_end_m == 0.08


def test_the_hand_feels_its_way_in_from_rest() -> None:
    transit, approach, close = plan().segments[:3]
    still = np.abs(transit.trajectory.qs - transit.trajectory.qs[-1]).max(axis=1) < 1e-9
    assert still.sum() > 15, "what the arm feels is compared with a torque at rest"
    assert approach.stop_on_contact
    assert approach.allowed_contacts == close.allowed_contacts
    assert approach.allowed_contacts == {AllowedContact.FINGERS_TARGET}
    assert approach.trajectory.duration_s > 5.0 * CONTACT_AFTER_S


def test_the_first_feasible_grasp_in_the_order_is_taken() -> None:
    other = grasp_from_above((0.5, 0.14, 0.125))
    found = grasps(IN_THE_TABLE, ABOVE_ONE, other)
    for order, expected in (((), 1), ((2, 0, 1), 2), ((0, 1), 1)):
        outcome = planned(found, order)
        assert isinstance(outcome, DropPlan)
        assert outcome.grasp == expected


def test_why_no_grasp_is_feasible_is_told() -> None:
    outcome = planned(grasps(IN_THE_TABLE, IN_THE_AIR))
    assert isinstance(outcome, PlanFailure)
    assert outcome.stage is Stage.PLANNING
    assert outcome.reason.startswith("none of 2 distinct grasps is feasible")
    assert outcome.statistics["nothing between the pads"] == 2
    assert outcome.statistics["collision at the grasp"] >= 1
    nothing = planned(PoseSet(GRASP, np.empty((0, 4, 4)), np.empty(0)))
    assert isinstance(nothing, PlanFailure)
    assert nothing.stage is Stage.PERCEPTION


def test_a_grasp_whose_palm_meets_a_neighbour_is_refused() -> None:
    # A post as high as the palm, 5 cm beside the grasp along the hand's width.
    post = box_cloud((0.5, 0.08), (0.02, 0.02, 0.16))
    problem = DropProblem(grasps(ABOVE_ONE), np.concatenate([ONE, post]), Q_HOME, LAYOUT)
    outcome = planner().plan(problem, np.random.default_rng(0))
    assert isinstance(outcome, PlanFailure)
    assert outcome.statistics["collision at the grasp"] >= 2


def test_impossible_problems_are_named() -> None:
    with pytest.raises(ValueError, match="has no bin"):
        DropProblem(grasps(ABOVE_ONE), ONE, Q_HOME, Layout())
    with pytest.raises(ValueError, match="cloud is empty"):
        DropProblem(grasps(ABOVE_ONE), np.empty((0, 3)), Q_HOME, LAYOUT)
    with pytest.raises(ValueError, match=r"q_start has shape \(6,\)"):
        DropProblem(grasps(ABOVE_ONE), ONE, Q_HOME[:6], LAYOUT)
