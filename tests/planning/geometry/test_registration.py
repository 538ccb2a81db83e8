"""Registration finds known motions of a mug, seen in part and with noise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planning.geometry.perceived import voxel_centroids
from planning.geometry.registration import NORMAL_NEIGHBOURS, nearest_start, register
from split_drake.poses import (
    Array,
    invert_pose,
    make_pose,
    rotation_error_rad,
    rotation_y,
    rotation_z,
    transform_points,
)
from tests.helpers.planning import HEIGHT_M, RADIUS_M, mug_cloud

NOISE_M = 0.001


def model() -> Array:
    return voxel_centroids(mug_cloud(), 0.0025)


def seen(X_AM: Array, rng: np.random.Generator, toward: tuple[float, float] = (0.0, -1.0)) -> Array:
    """Return (N, 3) the half of the moved mug that a camera in direction (x, y) of M shows."""
    points = voxel_centroids(mug_cloud() + np.array([0.0, 0.0, 0.0007]), 0.004)
    moved = transform_points(X_AM, points[points[:, :2] @ toward > -0.3 * RADIUS_M])
    return moved + rng.normal(scale=NOISE_M, size=moved.shape)


def motion(shift_m: float, turn_rad: float, rng: np.random.Generator) -> Array:
    """Return a motion of that size in a random direction, about the mug's middle."""
    axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    R = Rotation.from_rotvec(turn_rad * axis).as_matrix()
    middle = np.array([0.0, 0.0, HEIGHT_M / 2.0])
    return make_pose(R, middle - R @ middle + shift_m * direction)


@pytest.mark.parametrize("seed", range(6))
def test_a_known_motion_is_found_where_the_handle_is_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X_AM = motion(0.005, np.radians(6.0), rng)
    found = register(model(), seen(X_AM, rng))
    errors = transform_points(found.X_AM, model()) - transform_points(X_AM, model())
    assert np.linalg.norm(errors, axis=1).max() < 0.002
    assert found.matched > 0.95
    assert found.error_m == pytest.approx(NOISE_M, rel=0.4)


@pytest.mark.parametrize("seed", range(6))
def test_a_hidden_handle_leaves_only_the_turn_about_the_axis_open(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X_AM = motion(0.005, np.radians(6.0), rng)
    found = register(model(), seen(X_AM, rng, toward=(-1.0, 0.0)))
    axis = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, HEIGHT_M]])
    errors = transform_points(found.X_AM, axis) - transform_points(X_AM, axis)
    assert np.linalg.norm(errors, axis=1).max() < 0.002


def test_what_did_not_move_is_left_where_it_was() -> None:
    found = register(model(), seen(np.eye(4), np.random.default_rng(0)))
    assert np.linalg.norm(found.X_AM[:3, 3]) < 0.001
    assert rotation_error_rad(found.X_AM[:3, :3], np.eye(3)) < np.radians(1.0)


def test_a_round_body_without_a_handle_is_not_turned_about_its_axis() -> None:
    points = model()
    body = points[np.hypot(points[:, 0], points[:, 1]) < RADIUS_M + 0.001]
    turned = transform_points(make_pose(rotation_z(0.5), (0.0, 0.0, 0.004)), body)
    found = register(body, turned)
    assert found.X_AM[2, 3] == pytest.approx(0.004, abs=0.0005)
    assert rotation_error_rad(found.X_AM[:3, :3], np.eye(3)) < np.radians(2.0)


def test_another_object_does_not_match() -> None:
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(2000, 3))
    ball *= 0.06 / np.linalg.norm(ball, axis=1, keepdims=True)
    found = register(model(), ball + np.array([0.0, 0.0, HEIGHT_M / 2.0]))
    assert found.matched < 0.5


def test_too_few_points_are_refused() -> None:
    few = model()[: NORMAL_NEIGHBOURS - 1]
    with pytest.raises(ValueError, match=f"{len(few)} points; expected at least"):
        register(model(), few)
    with pytest.raises(ValueError, match=f"have {len(few)} and"):
        register(few, model())


def test_the_nearest_start_is_that_of_the_pivot_seen() -> None:
    rng = np.random.default_rng(0)
    about = make_pose(p=(RADIUS_M, 0.0, HEIGHT_M - 0.01))
    angles = np.radians([0.0, -24.0, 24.0, 48.0])
    starts = np.stack([about @ make_pose(rotation_y(a)) @ invert_pose(about) for a in angles])
    true = about @ make_pose(rotation_y(np.radians(20.0))) @ invert_pose(about)
    np.testing.assert_array_equal(nearest_start(model(), seen(true, rng), starts), starts[2])
    unmoved = seen(np.eye(4), rng)
    np.testing.assert_array_equal(nearest_start(model(), unmoved, starts), starts[0])
