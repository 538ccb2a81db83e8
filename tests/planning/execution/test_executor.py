"""Execution against a robot that follows its commands exactly."""

import numpy as np
import pytest

from planning.execution.executor import Executor
from planning.execution.faults import BLOCKING_FORCE_N, CONTACT_FORCE_N, Fault
from planning.problem import SAMPLE_S, Plan, Segment, SegmentName, Stage
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.panda import gripper_force, gripper_jacobian
from split_drake.robot.posture import Q_HOME
from tests.helpers.planning import reorient_plan
from tests.helpers.robot import PerfectRobot


@pytest.fixture(scope="module")
def plan() -> Plan:
    return reorient_plan()


def test_a_plan_runs_to_its_end_in_real_time(plan: Plan) -> None:
    robot, steps = PerfectRobot(), list[Segment]()
    result = Executor(robot, steps.append).execute(plan.segments)
    assert result.completed and result.stage is None and result.reason == ""
    assert [log.name for log in result.logs] == [segment.name for segment in plan.segments]
    assert robot.time_s == pytest.approx(len(steps) * SAMPLE_S)
    assert result.duration_s == pytest.approx(robot.time_s, abs=1e-9)
    assert max(log.tracking_error_rad for log in result.logs) < 1e-9
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_the_time_since_release_counts_what_follows_opening(plan: Plan) -> None:
    robot, opened_s = PerfectRobot(), 0.0

    def watch(segment: Segment) -> None:
        nonlocal opened_s
        if segment.name is SegmentName.OPEN:
            opened_s = robot.time_s

    result = Executor(robot, watch).execute(plan.segments)
    assert opened_s > 0.0
    assert result.since_release_s == pytest.approx(robot.time_s - opened_s, abs=1e-9)


def test_an_empty_hand_ends_the_execution(plan: Plan) -> None:
    result = Executor(PerfectRobot(object_m=0.0)).execute(plan.segments)
    assert not result.completed
    assert result.stage is Stage.GRASP
    assert result.logs[-1].name is SegmentName.CLOSE
    assert "0.0 mm" in result.reason
    with pytest.raises(ValueError, match="released"):
        _ = result.since_release_s


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        (SegmentName.LIFT, Stage.GRASP),
        (SegmentName.TRANSFER, Stage.TRANSPORT),
        (SegmentName.INSERT, Stage.PLACEMENT),
    ],
)
def test_a_lost_object_fails_the_stage_it_was_lost_in(
    plan: Plan, name: SegmentName, stage: Stage
) -> None:
    names = [segment.name for segment in plan.segments]
    before = plan.segments[: names.index(name)]
    begins_s = SAMPLE_S * sum(len(segment.trajectory.times_s) for segment in before)
    result = Executor(PerfectRobot(lost_s=begins_s + 0.05)).execute(plan.segments)
    assert not result.completed
    assert result.logs[-1].name is name
    assert result.stage is stage
    assert name.value in result.reason


def test_lowering_stops_on_contact_and_keeps_the_height_while_letting_go(plan: Plan) -> None:
    lowering = next(segment for segment in plan.segments if segment.stop_on_contact)
    heights = [gripper_pose(q)[2, 3] for q in lowering.trajectory.qs[[0, -1]]]
    floor_m = 0.5 * (heights[0] + heights[1])
    robot = PerfectRobot(floor_m=floor_m)
    reached: dict[SegmentName, list[float]] = {}

    def watch(segment: Segment) -> None:
        reached.setdefault(segment.name, []).append(gripper_pose(robot.q)[2, 3])

    result = Executor(robot, watch).execute(plan.segments)
    assert result.completed
    assert result.duration_s == pytest.approx(robot.time_s, abs=1e-9)
    stopped = [log.stopped_by_contact for log in result.logs]
    assert stopped == [segment.stop_on_contact for segment in plan.segments]
    pressed_m = floor_m - reached[SegmentName.INSERT][-1]
    assert CONTACT_FORCE_N / 20e3 < pressed_m < 0.002
    np.testing.assert_allclose(reached[SegmentName.OPEN], reached[SegmentName.INSERT][-1])
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_the_force_at_the_gripper_is_recovered_from_torques() -> None:
    q, force = Q_HOME, np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(gripper_force(q, gripper_jacobian(q).T @ force), force)


def test_an_insertion_stops_where_something_is_in_the_way(plan: Plan) -> None:
    insertion = next(segment for segment in plan.segments if segment.name is SegmentName.INSERT)
    heights = [gripper_pose(q)[2, 3] for q in insertion.trajectory.qs[[0, -1]]]
    floor_m = 0.5 * (heights[0] + heights[1])
    robot = PerfectRobot(floor_m=floor_m)
    result = Executor(robot).execute(plan.segments)
    assert not result.completed
    assert (result.fault, result.stage) == (Fault.BLOCKED, Stage.PLACEMENT)
    assert result.logs[-1].name is SegmentName.INSERT and result.logs[-1].stopped_by_contact
    pressed_m = floor_m - gripper_pose(robot.q)[2, 3]
    assert BLOCKING_FORCE_N / 20e3 < pressed_m < 0.005
    assert result.logs[-1].force_n > BLOCKING_FORCE_N


def test_a_slip_while_carrying_ends_the_execution(plan: Plan) -> None:
    robot = PerfectRobot(object_m=0.010)

    def slip(segment: Segment) -> None:
        if segment.name is SegmentName.TRANSFER:
            robot.object_m = 0.005

    result = Executor(robot, slip).execute(plan.segments)
    assert (result.fault, result.stage) == (Fault.SLIPPED, Stage.TRANSPORT)
    assert result.logs[-1].name is SegmentName.TRANSFER
    assert "10.0 mm to 5.0 mm" in result.reason
