"""Poses as arrays."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from split_drake.poses import (
    Array,
    check_poses,
    invert_pose,
    make_pose,
    rotation_error_rad,
    rotation_x,
    rotation_y,
    rotation_z,
    rounded_poses,
    transform_points,
)

seeds = st.integers(0, 2**32 - 1)


def random_poses(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_pose(
        Rotation.random(count, random_state=rng).as_matrix(), rng.normal(size=(count, 3))
    )


@given(seeds)
def test_inverse_cancels(seed: int) -> None:
    X_ABs = random_poses(seed, 5)
    np.testing.assert_allclose(
        invert_pose(X_ABs) @ X_ABs, np.tile(np.eye(4), (5, 1, 1)), atol=1e-12
    )


@given(seeds)
def test_transform_composes(seed: int) -> None:
    X_AB, X_BC = random_poses(seed, 2)
    p_CPs = np.random.default_rng(seed).normal(size=(7, 3))
    np.testing.assert_allclose(
        transform_points(X_AB @ X_BC, p_CPs),
        transform_points(X_AB, transform_points(X_BC, p_CPs)),
        atol=1e-12,
    )


def test_transform_broadcasts_over_poses() -> None:
    X_ABs = random_poses(0, 4)
    p_BPs = np.random.default_rng(1).normal(size=(7, 3))
    batch = transform_points(X_ABs, p_BPs)
    assert batch.shape == (4, 7, 3)
    np.testing.assert_allclose(batch[2], transform_points(X_ABs[2], p_BPs))


@pytest.mark.parametrize(
    ("rotation", "axis"), [(rotation_x, "x"), (rotation_y, "y"), (rotation_z, "z")]
)
@pytest.mark.parametrize("angle_rad", [-2.0, 0.0, 1e-9, np.pi])
def test_axis_rotations(rotation: Callable[[float], Array], axis: str, angle_rad: float) -> None:
    np.testing.assert_allclose(
        rotation(angle_rad), Rotation.from_euler(axis, angle_rad).as_matrix(), atol=1e-12
    )


@given(seeds, st.floats(0.0, np.pi))
def test_rotation_error_is_the_angle(seed: int, angle_rad: float) -> None:
    R_A = random_poses(seed, 1)[0, :3, :3]
    # arccos loses half the digits near 0 and pi.
    assert rotation_error_rad(R_A, R_A @ rotation_z(angle_rad)) == pytest.approx(
        angle_rad, abs=1e-6
    )


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (np.eye(3), "shape"),
        (np.full((4, 4), np.nan), "NaN"),
        (np.diag([2.0, 1.0, 1.0, 1.0]), "orthonormal"),
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "reflection"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
    ],
)
def test_bad_poses_are_named(pose: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=rf"X_WC.*{message}|{message}.*X_WC"):
        check_poses(pose, "X_WC")


@given(seeds)
def test_rounded_poses_forget_the_last_bits(seed: int) -> None:
    X_WPs = random_poses(seed, 50)
    rounded = rounded_poses(X_WPs, 4, 3)
    check_poses(rounded, "X_WPs")
    R = rounded[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(rounded[:, :3, 3], X_WPs[:, :3, 3], rtol=0.0, atol=0.5001e-4)
    assert rotation_error_rad(R, X_WPs[:, :3, :3]).max() < 2e-3
    noise = np.random.default_rng(seed).uniform(-2e-7, 2e-7, X_WPs.shape)
    moved = (rounded_poses(X_WPs + noise, 4, 3) != rounded).any(axis=(1, 2))
    assert moved.mean() < 0.2, "few poses lie so near to where rounding turns"


def test_no_poses_are_rounded_to_none() -> None:
    assert rounded_poses(np.empty((0, 4, 4)), 4, 3).shape == (0, 4, 4)
