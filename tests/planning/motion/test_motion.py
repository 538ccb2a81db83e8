"""Free motions and their timing: RRT-Connect, trajectory optimization, Toppra."""

from functools import cache

import numpy as np
import pytest

from planning.collision.world import EDGE_STEP_RAD, CollisionWorld, Situation
from planning.motion.free import MotionQuery, NoMotion, free_motion, rrt_motion, timed
from planning.motion.rrt import shortcut
from planning.motion.timing import CAREFUL, FREE, Speed, join, rest, time_path
from planning.motion.trajopt import optimize_path
from planning.problem import SAMPLE_S, JointTrajectory
from split_drake.poses import Array
from split_drake.robot.panda import arm_limits
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout
from tests.helpers.planning import configuration

LEFT, RIGHT = (0.5, -0.15, 0.12), (0.5, 0.15, 0.12)


@cache
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


def walled() -> Situation:
    """Return a wall across the workspace, which the hand must go around."""
    x, z = np.meshgrid(np.arange(0.35, 0.66, 0.02), np.arange(0.0, 0.2, 0.02))
    wall = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    return Situation(0.08, p_WStanding=wall)


def around_the_wall(seed: int) -> Array | None:
    ends = configuration(LEFT), configuration(RIGHT)
    path = free_motion(MotionQuery(world(), *ends, walled()), np.random.default_rng(seed))
    return None if isinstance(path, NoMotion) else path


def test_a_free_straight_motion_is_taken() -> None:
    ends = configuration(LEFT), configuration(RIGHT)
    path = free_motion(MotionQuery(world(), *ends, Situation(0.08)), np.random.default_rng(0))
    assert isinstance(path, np.ndarray)
    np.testing.assert_array_equal(path, np.stack(ends))


def test_a_way_around_an_obstacle_is_found_and_free() -> None:
    assert not world().path_free(np.stack([configuration(LEFT), configuration(RIGHT)]), walled())
    path = around_the_wall(0)
    assert path is not None
    np.testing.assert_allclose(path[[0, -1]], [configuration(LEFT), configuration(RIGHT)])
    assert world().path_free(path, walled())
    trajectory = timed(world(), path, walled(), FREE)
    assert world().path_free(trajectory.qs, walled())


def test_the_same_seed_gives_the_same_path() -> None:
    one, other = around_the_wall(3), around_the_wall(3)
    assert one is not None and other is not None
    np.testing.assert_array_equal(one, other)


def test_a_goal_in_collision_has_no_path() -> None:
    blocked = configuration((0.5, 0.0, 0.005))
    ends = configuration(LEFT), blocked
    for motion in (free_motion, rrt_motion):
        path = motion(MotionQuery(world(), *ends, Situation(0.08)), np.random.default_rng(0))
        assert isinstance(path, NoMotion)
        assert "RRT-Connect" in path.reason


def test_shortcuts_keep_the_ends_and_shorten() -> None:
    rng = np.random.default_rng(0)
    detour = np.stack([np.zeros(7), np.ones(7), np.array([1.0, -1.0] * 3 + [1.0]), np.zeros(7)])
    short = shortcut(detour, lambda qs: True, rng)
    np.testing.assert_array_equal(short[[0, -1]], detour[[0, -1]])

    def length(path: Array) -> float:
        return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())

    assert length(short) < 0.7 * length(detour)


def test_optimized_paths_keep_their_ends_and_are_no_longer() -> None:
    corner = configuration((0.5, 0.0, 0.35))
    path = np.stack([configuration(LEFT), corner, configuration(RIGHT)])
    smooth = optimize_path(world().checker, path, 0.08)
    assert smooth is not None
    np.testing.assert_array_equal(smooth[[0, -1]], path[[0, -1]])
    lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (smooth, path)]
    assert lengths[0] < lengths[1]


@pytest.mark.parametrize("speed", [FREE, CAREFUL])
def test_timing_keeps_the_limits_and_the_path(speed: Speed) -> None:
    path = np.stack([Q_HOME, configuration(LEFT), configuration(RIGHT)])
    trajectory = time_path(path, speed)
    limits = arm_limits()
    np.testing.assert_allclose(trajectory.qs[[0, -1]], path[[0, -1]], atol=1e-6)
    np.testing.assert_allclose(np.diff(trajectory.times_s), SAMPLE_S)
    assert np.all(np.abs(trajectory.vs) <= 1.02 * speed.velocity * limits.v_max)
    accelerations = np.diff(trajectory.vs, axis=0) / SAMPLE_S
    assert np.all(np.abs(accelerations) <= 1.3 * speed.acceleration * limits.a_max)
    assert not trajectory.vs[[0, -1]].any()
    corner = np.abs(trajectory.qs - path[1]).max(axis=1).min()
    assert corner < EDGE_STEP_RAD


def test_the_corners_of_long_paths_keep_the_limits_as_well() -> None:
    rng = np.random.default_rng(1)
    path = Q_HOME + rng.uniform(-0.6, 0.6, (9, 7))
    accelerations = np.diff(time_path(path, FREE).vs, axis=0) / SAMPLE_S
    # The last step is shorter than the others.
    assert np.all(np.abs(accelerations[:-1]) <= 1.5 * FREE.acceleration * arm_limits().a_max)


# A path on which Toppra with 8 points a knot drives a corner at four times the arm's limit.
SHARP = """
    0.0008 -0.9    -0.0005 -2.5006 -0.0004 1.5995 0.7856
    0.0401 -0.8303 -0.081  -2.4942  0.0144 1.6162 0.8395
    0.0543 -0.8126 -0.1002 -2.4922  0.0221 1.6204 0.8587
    0.1302 -0.7244 -0.1947 -2.4816  0.0648 1.6414 0.9611
    0.1425 -0.7107 -0.2093 -2.4799  0.0719 1.6446 0.9776
    0.2091 -0.637  -0.2872 -2.4708  0.1105 1.6621 1.0673
    0.334  -0.5002 -0.4317 -2.4537  0.1834 1.6945 1.2354
    0.8153  0.0261 -0.9874 -2.3881  0.4642 1.8192 1.8831
    0.8886  0.1061 -1.0719 -2.3781  0.5069 1.8381 1.9816
    1.4335  0.6981 -1.696  -2.3039  0.826  1.9783 2.7147
    1.4372  0.7018 -1.6998 -2.3034  0.8283 1.9792 2.7197
    1.543   0.6965 -1.6632 -2.2938  0.9264 1.9768 2.8573
"""


def test_a_corner_that_is_driven_too_fast_is_timed_again() -> None:
    path = np.array(SHARP.split(), dtype=float).reshape(-1, 7)
    trajectory = time_path(path, FREE)
    moved = np.diff(trajectory.qs, axis=0) / SAMPLE_S
    accelerations = np.diff(moved, axis=0) / SAMPLE_S
    assert np.all(np.abs(accelerations) <= arm_limits().a_max)
    assert trajectory.duration_s < 3.0, "it does not stop at every corner"


@pytest.mark.parametrize("middle", [[0.3, 0.3 + 1e-6], [0.3, 0.0], [0.3, 0.3, 1e-5]])
def test_paths_that_dwell_or_turn_back_are_driven_in_seconds(middle: list[float]) -> None:
    qs = np.tile(Q_HOME, (len(middle) + 2, 1))
    qs[:, 0] = [0.0, *middle, 0.4]
    trajectory = time_path(qs, FREE)
    assert trajectory.duration_s < 5.0
    np.testing.assert_allclose(trajectory.qs[[0, -1]], qs[[0, -1]], atol=1e-6)


def test_rest_and_joining() -> None:
    pause = rest(Q_HOME, 0.5)
    assert pause.duration_s == pytest.approx(0.5)
    both = join([pause, pause])
    assert both.duration_s == pytest.approx(1.0)
    assert len(both.times_s) == 2 * len(pause.times_s) - 1


def test_trajectories_that_make_no_sense_are_errors() -> None:
    with pytest.raises(ValueError, match="expected"):
        JointTrajectory(np.zeros(3), np.zeros((2, 7)), np.zeros((3, 7)))
    with pytest.raises(ValueError, match="ascend"):
        JointTrajectory(np.array([0.0, 0.0]), np.zeros((2, 7)), np.zeros((2, 7)))


@pytest.mark.parametrize("motion_rad", [0.0, 1e-7, 2e-6])
def test_hardly_any_motion_is_timed_as_well(motion_rad: float) -> None:
    qs = np.stack([Q_HOME, Q_HOME + motion_rad])
    trajectory = time_path(qs, FREE)
    np.testing.assert_allclose(trajectory.qs[[0, -1]], qs, atol=1e-6)
    assert trajectory.duration_s > 0.0
