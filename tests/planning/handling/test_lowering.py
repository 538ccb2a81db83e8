"""What is to be let go is lowered on where nothing was felt, and not let go over nothing."""

from collections.abc import Callable

import numpy as np
import pytest

from planning.collision.world import CollisionWorld
from planning.execution.executor import Executor
from planning.execution.faults import Fault
from planning.handling.attempts import AttemptLimits
from planning.handling.lowering import FURTHER_M, Lowering
from planning.problem import Segment, SegmentName, Stage
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.layout import Layout
from tests.helpers.handling import WIDTH_M, Placer, failures, handle
from tests.helpers.planning import reorient_plan
from tests.helpers.robot import PerfectRobot


def lowering_segment() -> Segment:
    """Return the segment of a plan in which what is held is lowered by feel."""
    (segment,) = (s for s in reorient_plan().place if s.holding and s.stop_on_contact)
    return segment


def robot_at_the_end(floor_below_m: float) -> PerfectRobot:
    """Return a robot that has lowered its object by plan, over a floor so far below."""
    q_end = lowering_segment().trajectory.qs[-1].copy()
    robot = PerfectRobot(WIDTH_M, q=q_end, opening_m=WIDTH_M)
    robot.floor_m = float(gripper_pose(robot.q)[2, 3]) - floor_below_m
    return robot


@pytest.fixture
def no_room_below() -> None:
    """Here things are lowered on: this takes the place of the fixture of all other tests."""


@pytest.fixture
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


def test_it_is_lowered_on_until_something_is_felt(world: CollisionWorld) -> None:
    robot = robot_at_the_end(0.5 * FURTHER_M)
    start_m = float(gripper_pose(robot.q)[2, 3])
    done = Lowering(Executor(robot), world).go_on(lowering_segment())
    assert done.completed and done.logs[-1].stopped_by_contact
    lowered_m = start_m - float(gripper_pose(robot.q)[2, 3])
    assert lowered_m == pytest.approx(0.5 * FURTHER_M, abs=1e-3)


def test_over_nothing_the_arm_moves_up_again_and_says_so(world: CollisionWorld) -> None:
    robot = robot_at_the_end(np.inf)
    q_start = robot.q.copy()
    done = Lowering(Executor(robot), world).go_on(lowering_segment())
    assert not done.completed and done.fault is Fault.MISSED and done.stage is Stage.PLACEMENT
    np.testing.assert_allclose(robot.q, q_start, atol=1e-3)


def test_an_arm_that_loses_the_object_on_the_way_moves_up_again_as_well(
    world: CollisionWorld,
) -> None:
    robot = robot_at_the_end(np.inf)
    robot.lost_s = 0.3
    q_start = robot.q.copy()
    done = Lowering(Executor(robot), world).go_on(lowering_segment())
    assert not done.completed and done.fault is Fault.EMPTY
    np.testing.assert_allclose(robot.q, q_start, atol=1e-3)


def test_where_the_arm_can_move_no_lower_nothing_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planning.handling.lowering.follow", lambda *_: None)
    robot = robot_at_the_end(np.inf)
    done = Lowering(Executor(robot), CollisionWorld(Layout())).go_on(lowering_segment())
    assert done.completed and not done.logs and robot.time_s == 0.0


def lowest_m() -> float:
    return float(gripper_pose(lowering_segment().trajectory.qs[-1])[2, 3])


def table_at(robot: PerfectRobot, height_m: float) -> Callable[[Segment], None]:
    """Return what lets the held object bear on a table once it is lowered by feel."""

    def on_step(segment: Segment) -> None:
        feeling = segment.holding and segment.stop_on_contact
        robot.floor_m = height_m if feeling else -np.inf

    return on_step


def test_an_object_that_bears_lower_than_planned_is_let_go_there() -> None:
    robot, opened_m = PerfectRobot(WIDTH_M), list[float]()
    bears = table_at(robot, lowest_m() - 0.5 * FURTHER_M)

    def on_step(segment: Segment) -> None:
        bears(segment)
        if segment.name is SegmentName.OPEN:
            opened_m.append(float(gripper_pose(robot.q)[2, 3]))

    handled = handle(robot, Placer(), on_step)
    assert failures(handled) == [None]
    np.testing.assert_allclose(opened_m, lowest_m() - 0.5 * FURTHER_M, atol=1e-3)
    (attempt,) = handled.attempts
    assert attempt.execution is not None
    names = [log.name for log in attempt.execution.logs]
    assert names == [segment.name for segment in reorient_plan().segments], "a log a segment"
    lowering = attempt.execution.logs[names.index(SegmentName.OPEN) - 1]
    assert lowering.stopped_by_contact
    assert lowering.duration_s > lowering_segment().trajectory.duration_s


def test_an_object_that_bears_on_nothing_is_not_let_go() -> None:
    robot, opened = PerfectRobot(WIDTH_M), list[Segment]()

    def on_step(segment: Segment) -> None:
        if segment.name is SegmentName.OPEN and not put_down[0]:
            opened.append(segment)
        put_down[0] |= segment.name is SegmentName.BACK_OUT

    put_down = [False]
    handled = handle(robot, Placer(), on_step)
    assert failures(handled)[0] is Stage.PLACEMENT and not opened
    assert "nothing was felt" in handled.attempts[0].failure[1]
    assert handled.attempts[-1].recovery == "put the object down"


def test_without_feedback_a_plan_is_executed_as_it_is() -> None:
    handled = handle(PerfectRobot(WIDTH_M), Placer(), limits=AttemptLimits.without_feedback())
    assert failures(handled) == [None]
