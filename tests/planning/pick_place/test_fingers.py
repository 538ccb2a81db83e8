"""Openings and small corrections of grasps, from a cloud."""

import numpy as np
import pytest

from planning.pick_place.fingers import (
    ENOUGH_CLEARANCE_M,
    MAX_CENTERING_M,
    MAX_SQUARING_RAD,
    fit_fingers,
    settled,
)
from split_drake.poses import Array, make_pose, rotation_error_rad, rotation_x, rotation_z
from split_drake.robot.gripper import PAD_SIZE_M, PAD_THICKNESS_M

WALL_M = 0.004


def wall(far_m: float | None = None) -> Array:
    """Return both faces of a wall across y_G whose rim is at z_G = 0, and another one beyond."""
    x, z = np.meshgrid(np.arange(-0.04, 0.041, 0.004), np.arange(0.0, 0.05, 0.004))
    faces = [-WALL_M / 2.0, WALL_M / 2.0] + ([] if far_m is None else [far_m])
    return np.concatenate(
        [np.column_stack([x.ravel(), np.full(x.size, y), z.ravel()]) for y in faces]
    )


def test_a_wall_alone_leaves_all_the_room_there_is() -> None:
    fit = fit_fingers(np.eye(4), wall())
    assert fit.clearance_m == ENOUGH_CLEARANCE_M
    assert fit.opening_m >= WALL_M + 2.0 * ENOUGH_CLEARANCE_M
    assert fit.release_m == pytest.approx(0.08)
    assert fit.pinch_depth_m == pytest.approx(PAD_SIZE_M[1] / 2.0, abs=0.001)
    assert fit.held_width_m == pytest.approx(WALL_M)


def test_a_second_wall_narrows_the_opening() -> None:
    fit = fit_fingers(np.eye(4), wall(far_m=0.030))
    finger_outside = fit.opening_m / 2.0 + PAD_THICKNESS_M
    assert finger_outside + fit.clearance_m <= 0.030 + 1e-9
    assert 0.0 < fit.clearance_m < ENOUGH_CLEARANCE_M
    assert fit.release_m < 0.04


def test_the_unseen_side_of_what_is_held_counts_as_wide_as_the_seen_one() -> None:
    one_side = np.array([[0.0, 0.012, 0.0], [0.0, 0.013, 0.005]])
    assert fit_fingers(np.eye(4), one_side).held_width_m == pytest.approx(0.026)


def test_no_opening_clears_what_fills_the_hand() -> None:
    y = np.arange(-0.08, 0.081, 0.004)
    slab = np.column_stack([0.0 * y, y, 0.0 * y])
    assert fit_fingers(np.eye(4), slab).clearance_m == 0.0


def test_nothing_between_the_pads_is_no_pinch() -> None:
    below = np.add(wall(), (0.0, 0.0, 0.02))
    fit = fit_fingers(np.eye(4), below)
    assert fit.pinch_depth_m == fit.held_width_m == 0.0
    np.testing.assert_array_equal(settled(np.eye(4), np.empty((0, 3))), np.eye(4))


@pytest.mark.parametrize("R", [rotation_x(np.radians(8.0)), rotation_z(np.radians(-10.0))])
def test_crooked_grasps_are_squared_up_and_centred(R: Array) -> None:
    crooked = make_pose(R, (0.0, 0.003, 0.0))
    X_WG = settled(crooked, wall())
    assert abs(X_WG[1, 1]) > np.cos(np.radians(1.5))
    assert abs(X_WG[1, 3]) < 0.001


def test_corrections_are_small() -> None:
    far_off = make_pose(rotation_z(np.radians(30.0)), (0.0, 0.009, 0.0))
    X_WG = settled(far_off, wall())
    assert rotation_error_rad(X_WG[:3, :3], far_off[:3, :3]) < MAX_SQUARING_RAD
    assert np.linalg.norm(X_WG[:3, 3] - far_off[:3, 3]) <= MAX_CENTERING_M


def test_round_things_are_not_squared_up() -> None:
    angle, z = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 40), np.arange(-0.02, 0.02, 0.002))
    rod = np.column_stack([0.005 * np.cos(angle).ravel(), 0.005 * np.sin(angle).ravel(), z.ravel()])
    grasp = make_pose(rotation_z(0.2))
    np.testing.assert_allclose(settled(grasp, rod)[:3, :3], grasp[:3, :3], atol=1e-9)


def test_a_bulge_between_the_stems_leaves_them_no_room() -> None:
    straight = np.concatenate([wall(), wall() - (0.0, 0.0, 0.03)])
    bulge = np.add(wall(), (0.0, 0.009, -0.04))
    bulging = np.concatenate([wall(), bulge[bulge[:, 2] < -0.012]])
    assert fit_fingers(np.eye(4), straight).stem_room_m > 0.005
    assert fit_fingers(np.eye(4), bulging).stem_room_m < 0.0
