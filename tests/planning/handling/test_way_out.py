"""Ways out of an object that an open hand is caught on."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from planning.collision.world import CollisionWorld
from planning.execution.executor import ExecutionResult, Executor
from planning.execution.faults import CATCHING_FORCE_N, Fault
from planning.handling.way_out import FREE_FORCE_N, LEAN_RAD, WayOut, leaned
from planning.problem import SegmentName, Stage
from split_drake.poses import Array
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.panda import gripper_jacobian
from split_drake.station.layout import Layout
from tests.helpers.planning import configuration
from tests.helpers.robot import PerfectRobot

CAUGHT = ExecutionResult(False, (), Stage.PLACEMENT, "caught", Fault.CAUGHT)
UP = np.array([0.0, 0.0, 1.0])
# Where the hand, which points down, begins.
P_WSTART = (0.5, -0.15, 0.12)


def way_out(robot: PerfectRobot) -> WayOut:
    return WayOut(Executor(robot), CollisionWorld(Layout()))


def height_m(robot: PerfectRobot) -> float:
    return float(gripper_pose(robot.q)[2, 3])


@pytest.mark.parametrize("along_n", [-15.0, 0.0, 15.0])
def test_a_way_leans_to_where_the_hand_is_pushed(along_n: float) -> None:
    direction = leaned(UP, np.array([3.0, -4.0, along_n]))
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    assert np.arccos(direction @ UP) == pytest.approx(LEAN_RAD)
    np.testing.assert_allclose(direction[:2], np.sin(LEAN_RAD) * np.array([0.6, -0.8]))


def test_a_force_along_the_way_leaves_it_as_it_is() -> None:
    np.testing.assert_array_equal(leaned(UP, np.array([0.9 * FREE_FORCE_N, 0.0, -15.0])), UP)


def test_the_next_way_leans_further() -> None:
    push = np.array([10.0, 0.0, -10.0])
    assert np.arccos(leaned(leaned(UP, push), push) @ UP) == pytest.approx(2.0 * LEAN_RAD)


def pressed(normal_W: tuple[float, float, float]) -> PerfectRobot:
    """Return a robot whose hand points down and is a millimetre deep in a wall."""
    q = configuration(P_WSTART)
    floor_m = float(np.dot(normal_W, gripper_pose(q)[:3, 3])) + 0.001
    return PerfectRobot(q=q, floor_m=floor_m, normal_W=normal_W)


def test_a_hand_slides_out_along_a_slope() -> None:
    robot = pressed((0.8, 0.0, -0.6))
    start = gripper_pose(robot.q)[:3, 3]
    done = way_out(robot).take(CAUGHT, 0.0, tries=3)
    assert done.completed and done.stage is None and done.fault is None
    moved = gripper_pose(robot.q)[:3, 3] - start
    assert moved[2] > 0.04 and moved[0] > 0.0


def test_a_hand_first_moves_in_again_as_far_as_it_had_drawn_back() -> None:
    """There it feels nothing, so that what follows is the way out alone."""
    robot = pressed((0.8, 0.0, -0.6))
    start_m, lowest_m = height_m(robot), [np.inf]

    def on_step(segment: object) -> None:
        lowest_m[0] = min(lowest_m[0], height_m(robot))

    out = WayOut(Executor(robot, on_step), CollisionWorld(Layout()))
    done = out.take(CAUGHT, 0.02, tries=3)
    assert done.completed
    assert lowest_m[0] == pytest.approx(start_m - 0.02, abs=1e-3)
    assert height_m(robot) > start_m + 0.04


@dataclass
class RobotInSlot(PerfectRobot):
    """Its hand is between two walls, of which one, a spring of 2 N/mm, pushes it towards +x."""

    wall_x_m: float = 0.0
    opening_m: float = field(default=0.06)

    @property
    def joint_torques_nm(self) -> Array:
        depth = max(0.0, self.wall_x_m - gripper_pose(self.q)[0, 3])
        return gripper_jacobian(self.q).T @ np.array([-2e3 * depth, 0.0, 0.0])


def test_a_hand_steps_aside_until_it_hardly_feels_anything() -> None:
    robot = RobotInSlot(q=configuration(P_WSTART), wall_x_m=P_WSTART[0] + 0.007)
    done = way_out(robot).take(CAUGHT, 0.0, tries=1)
    assert done.completed
    eased = [log for log in done.logs if log.name is SegmentName.EASE]
    assert len(eased) == 2 * 3, "three steps of 3 mm, and a rest after each"


def test_a_hand_under_a_ceiling_gives_up_after_the_last_try() -> None:
    robot = pressed((0.0, 0.0, -1.0))
    done = way_out(robot).take(CAUGHT, 0.0, tries=3)
    assert done.fault is Fault.CAUGHT and done.reason == "caught"
    ways = [log for log in done.logs if log.name is SegmentName.RETREAT]
    assert len(ways) == 3 and all(log.force_n > CATCHING_FORCE_N for log in ways)


def test_without_tries_the_hand_stays_where_it_is() -> None:
    robot = pressed((0.0, 0.0, -1.0))
    before = robot.q.copy()
    assert way_out(robot).take(CAUGHT, 0.02, tries=0) == CAUGHT
    np.testing.assert_array_equal(robot.q, before)
