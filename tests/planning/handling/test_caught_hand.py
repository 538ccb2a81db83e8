"""A hand that an object catches when it lets go of it, or puts it down."""

from dataclasses import replace

import numpy as np
import pytest

from planning.execution.executor import ExecutionResult
from planning.execution.faults import CATCHING_FORCE_N
from planning.goals.hang import SUBGOAL as HANG
from planning.handling.attempts import AttemptLimits
from planning.handling.held_view import HeldView
from planning.handling.way_out import WayOut
from planning.motion.free import NoMotion
from planning.problem import Segment, SegmentName, Stage
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from tests.helpers.handling import WIDTH_M, Placer, catch, failures, handle
from tests.helpers.planning import reorient_plan
from tests.helpers.robot import PerfectRobot

# Against the way back, which leads up, and sideways: the hand can slide along it.
SLOPE_W = (0.8, 0.0, -0.6)


def test_a_hand_that_is_caught_slides_out_along_what_it_feels() -> None:
    robot = PerfectRobot(WIDTH_M)
    handled = handle(robot, Placer(), catch(robot, SLOPE_W))
    (attempt,) = handled.attempts
    assert attempt.failure == (None, "") and attempt.recovery == "eased the hand out"
    assert attempt.execution is not None
    logs = list(attempt.execution.logs)
    after = logs[[log.name for log in logs].index(SegmentName.OPEN) + 1 :]
    caught, *between, out = (log for log in after if log.name is not SegmentName.EASE)
    assert caught.name is out.name is SegmentName.RETREAT
    assert all(log.stopped_by_contact for log in (caught, *between))
    assert caught.force_n > CATCHING_FORCE_N and not out.stopped_by_contact
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_ways_out_know_how_far_the_hand_had_drawn_back(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, drawn_m, found_m = PerfectRobot(WIDTH_M), 0.03, list[float]()

    def take(way: WayOut, caught: ExecutionResult, depth_m: float, tries: int) -> ExecutionResult:
        found_m.append(depth_m)
        return caught

    def on_step(segment: Segment) -> None:
        """Catch the hand where it has drawn back, upwards, by so much."""
        if segment.name is SegmentName.OPEN:
            released_m[0] = float(gripper_pose(robot.q)[2, 3])
        elif segment.name is SegmentName.RETREAT and robot.floor_m == -np.inf:
            robot.normal_W, robot.floor_m = (0.0, 0.0, -1.0), -released_m[0] - drawn_m

    released_m = [0.0]
    monkeypatch.setattr(WayOut, "take", take)
    handle(robot, Placer(), on_step)
    assert found_m[0] == pytest.approx(drawn_m, abs=3e-3)


def test_a_robot_that_eased_its_hand_out_but_finds_no_way_home_has_failed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("planning.handling.recovery.free_motion", lambda *_: NoMotion("walled in"))
    robot = PerfectRobot(WIDTH_M)
    handled = handle(robot, Placer(), catch(robot, SLOPE_W))
    (attempt,) = handled.attempts
    assert attempt.failure == (Stage.PLACEMENT, "no way home was found") and not handled.home


@pytest.mark.parametrize("tries", [0, 2])
def test_a_hand_that_stays_caught_says_so(tries: int) -> None:
    robot = PerfectRobot(WIDTH_M)
    limits = AttemptLimits(ways_out=tries)
    handled = handle(robot, Placer(), catch(robot, (0.0, 0.0, -1.0)), limits)
    assert failures(handled) == [Stage.PLACEMENT] and not handled.home
    (attempt,) = handled.attempts
    assert "caught on the object" in attempt.failure[1]
    assert attempt.recovery == "the hand stayed caught"
    assert attempt.execution is not None
    retreats = [log for log in attempt.execution.logs if log.name is SegmentName.RETREAT]
    assert len(retreats) == 1 + tries and all(log.stopped_by_contact for log in retreats)


def test_a_hand_that_is_caught_where_it_puts_the_object_down_slides_out_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lost = HeldView(np.eye(4), 0.4, "40% of it matches", elsewhere=True)
    monkeypatch.setattr("planning.handling.handler.view_held", lambda *_: lost)
    robot = PerfectRobot(WIDTH_M)
    handled = handle(robot, Placer(), catch(robot, SLOPE_W))
    assert handled.home and handled.attempts[-1].recovery == "put the object down"
    robot = PerfectRobot(WIDTH_M)
    handled = handle(robot, Placer(), catch(robot, (0.0, 0.0, -1.0)))
    assert not handled.home
    assert handled.attempts[-1].recovery == "put the object down; the hand stayed caught"


def test_a_hung_object_is_left_where_the_hand_was_eased_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rest of the plan, which leads back from the hook, starts elsewhere."""
    robot = PerfectRobot(WIDTH_M)
    plan = replace(reorient_plan(), subgoal=HANG)
    handled = handle(robot, Placer(), catch(robot, SLOPE_W), plan=plan)
    (attempt,) = handled.attempts
    assert attempt.failure == (None, "") and attempt.recovery == "eased the hand out"
    assert np.abs(robot.q - Q_HOME).max() > 0.1
