"""Identities of the pose algebra."""

import numpy as np
import pytest

from planning.collision.exemptions import MAX_LOWERING_M, TUBE_RADIUS_M, peg_tube
from planning.geometry.waypoints import (
    backed_off,
    place_grasp,
    polyline,
    shifted,
    straight_line,
    with_half_turns,
)
from planning.goals.hang import hook_goals
from planning.goals.upright import upright_goals
from split_drake.pose_task import GRASP, HANDLE
from split_drake.poses import (
    Array,
    check_poses,
    invert_pose,
    make_pose,
    rotation_x,
    rotation_y,
    rotation_z,
)
from split_drake.station.layout import Layout

X_WK = Layout().X_WK


def random_pose(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(-np.pi, np.pi, 3)
    return make_pose(rotation_z(a) @ rotation_y(b) @ rotation_x(c), rng.uniform(-0.5, 0.5, 3))


def test_at_theta_zero_the_handle_points_up_and_the_peg_runs_through_it() -> None:
    hook = make_pose(p=(0.5, -0.4, 0.4))
    up, flipped = hook_goals(hook, 0.0)
    for X_WH in (up, flipped):
        np.testing.assert_allclose(X_WH[:3, 0], (0.0, 0.0, 1.0), atol=1e-12)
        np.testing.assert_allclose(X_WH[:3, 3], hook[:3, 3], atol=1e-12)
    np.testing.assert_allclose(up[:3, 1], hook[:3, 1], atol=1e-12)
    np.testing.assert_allclose(flipped[:3, 1], -hook[:3, 1], atol=1e-12)


def test_hook_goals_turn_about_the_peg_and_come_in_both_symmetries() -> None:
    thetas = np.radians([-60.0, 0.0, 45.0])
    goals = hook_goals(X_WK, thetas)
    assert goals.shape == (6, 4, 4)
    check_poses(goals, "goals")
    np.testing.assert_allclose(goals[3:], goals[:3] @ HANDLE.symmetry.X_half_turn, atol=1e-12)
    R_KHs = X_WK[:3, :3].T @ goals[:, :3, :3]
    np.testing.assert_allclose(R_KHs[2], rotation_y(-np.pi / 2.0 + np.radians(45.0)), atol=1e-12)


def test_a_held_object_moves_with_the_gripper() -> None:
    X_WO, X_WG, X_WOgoal = random_pose(0), random_pose(1), random_pose(2)
    X_WGgoal = place_grasp(X_WOgoal, X_WO, X_WG)
    X_GO = invert_pose(X_WG) @ X_WO
    np.testing.assert_allclose(X_WGgoal @ X_GO, X_WOgoal, atol=1e-12)
    np.testing.assert_allclose(place_grasp(X_WO, X_WO, X_WG), X_WG, atol=1e-12)


def test_half_turns_keep_the_approach_and_swap_the_fingers() -> None:
    X_WGs = np.stack([random_pose(3), random_pose(4)])
    both = with_half_turns(X_WGs)
    np.testing.assert_allclose(both[2:, :3, 2], X_WGs[:, :3, 2], atol=1e-12)
    np.testing.assert_allclose(both[2:, :3, 1], -X_WGs[:, :3, 1], atol=1e-12)
    np.testing.assert_allclose(both[2:] @ GRASP.symmetry.X_half_turn, X_WGs, atol=1e-12)


def test_offsets() -> None:
    X_WG = random_pose(5)
    np.testing.assert_allclose(
        (invert_pose(X_WG) @ backed_off(X_WG, 0.08))[:3, 3], (0.0, 0.0, -0.08), atol=1e-12
    )
    np.testing.assert_allclose(shifted(X_WG, (0.0, 0.0, 0.1))[2, 3], X_WG[2, 3] + 0.1)


def test_upright_goals_stand_at_every_place_and_yaw() -> None:
    goals = upright_goals(np.array([[0.4, 0.0, 0.0], [0.5, 0.1, 0.0]]), np.radians([0.0, 90.0]))
    assert goals.shape == (4, 4, 4)
    np.testing.assert_allclose(goals[:, 2, 2], 1.0)
    np.testing.assert_allclose(goals[1, :3, 0], (0.0, 1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(goals[2:, :3, 3], [[0.5, 0.1, 0.0]] * 2)


def test_straight_lines_end_where_they_should_in_equal_steps() -> None:
    X_WA = random_pose(6)
    X_WB = shifted(X_WA, (0.03, -0.04, 0.0))
    line = straight_line(X_WA, X_WB, 0.01)
    assert len(line) == 5
    np.testing.assert_allclose(line[-1], X_WB, atol=1e-12)
    steps = np.diff(np.concatenate([X_WA[None], line])[:, :3, 3], axis=0)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 0.01)
    there_and_back = polyline([X_WA, X_WB, X_WA], 0.01)
    assert len(there_and_back) == 11
    np.testing.assert_allclose(there_and_back[-1], X_WA, atol=1e-12)


def test_straight_lines_do_not_turn() -> None:
    with pytest.raises(ValueError, match="rotations"):
        straight_line(random_pose(7), random_pose(8), 0.01)


def test_the_tube_exempts_the_opening_and_nothing_else() -> None:
    X_WH = random_pose(9)
    X_WHgoal = hook_goals(X_WK, 0.0)[0]
    p_HPs = np.array(
        [
            [0.0, 0.0, 0.0],
            [0.0, 0.029, 0.9 * TUBE_RADIUS_M],
            [0.0, 0.031, 0.0],
            [0.0, 0.0, 1.1 * TUBE_RADIUS_M],
            [MAX_LOWERING_M + 0.9 * TUBE_RADIUS_M, 0.0, 0.0],
            [-1.1 * TUBE_RADIUS_M, 0.0, 0.0],
        ]
    )
    p_WPs = p_HPs @ X_WH[:3, :3].T + X_WH[:3, 3]
    lowered = [True, True, False, False, True, False]
    assert peg_tube(p_WPs, X_WH, X_WHgoal, MAX_LOWERING_M).tolist() == lowered
    straight = [True, True, False, False, False, False]
    assert peg_tube(p_WPs, X_WH, X_WHgoal).tolist() == straight
