"""Ways out of an object that an open hand is caught on."""

import numpy as np
import pytest

from planning.collision.world import CollisionWorld
from planning.execution.executor import Executor
from planning.execution.faults import CATCHING_FORCE_N, Fault
from planning.handling.way_out import MIN_SIDEWAYS_N, WayOut, ways_out
from split_drake.poses import make_pose, rotation_x
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.layout import Layout
from tests.helpers.planning import configuration
from tests.helpers.robot import PerfectRobot

DOWN = make_pose(rotation_x(np.pi), (0.5, -0.15, 0.12))
NOWHERE = np.array([[0.5, 0.0, 0.02]])


@pytest.mark.parametrize("slope_deg", [0.0, 20.0, 40.0])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_ways_out_lead_up_and_off_the_surface(slope_deg: float, friction: float) -> None:
    sine, cosine = np.sin(np.radians(slope_deg)), np.cos(np.radians(slope_deg))
    normal = np.array([cosine, 0.0, -sine])
    along = np.array([sine, 0.0, cosine])
    directions = ways_out(DOWN, 15.0 * (normal - friction * along))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.all(directions[:, 2] > 0.2), "they lead back"
    assert np.linalg.norm(np.diff(directions, axis=0), axis=1).min() > 0.1, "they differ"
    assert directions[0] @ normal > -0.05, "the first does not press on"
    assert np.all(np.abs(directions[:, 1]) < 1e-12)


def test_a_force_straight_along_the_approach_leaves_the_way_straight_back() -> None:
    for force_n in (-15.0, 15.0):
        directions = ways_out(DOWN, np.array([0.9 * MIN_SIDEWAYS_N, 0.0, force_n]))
        np.testing.assert_allclose(directions, [[0.0, 0.0, 1.0]], atol=1e-12)


def pressed(normal_W: tuple[float, float, float]) -> PerfectRobot:
    """Return a robot whose hand points down and is a millimetre deep in a wall."""
    q = configuration((0.5, -0.15, 0.12))
    floor_m = float(np.dot(normal_W, gripper_pose(q)[:3, 3])) + 0.001
    return PerfectRobot(q=q, floor_m=floor_m, normal_W=normal_W)


def test_a_hand_slides_out_along_a_slope() -> None:
    robot = pressed((0.8, 0.0, -0.6))
    start = gripper_pose(robot.q)
    done = WayOut(Executor(robot), CollisionWorld(Layout())).take(NOWHERE, tries=2)
    assert done is not None and done.completed and len(done.logs) == 1
    moved = gripper_pose(robot.q)[:3, 3] - start[:3, 3]
    assert moved[2] > 0.04 and moved[0] > 0.0
    assert np.linalg.norm(moved) == pytest.approx(0.08, abs=1e-4)


def test_a_hand_under_a_ceiling_gives_up_after_the_last_try() -> None:
    robot = pressed((0.0, 0.0, -1.0))
    done = WayOut(Executor(robot), CollisionWorld(Layout())).take(NOWHERE, tries=3)
    assert done is not None and done.fault is Fault.CAUGHT and len(done.logs) == 3
    assert all(log.force_n > CATCHING_FORCE_N for log in done.logs)
