"""Poses as arrays: building, checking, inverting and comparing (4, 4) homogeneous matrices."""

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_ROTATION_TOLERANCE = 1e-4
# |R R^T - I| of a rotation whose entries have three digits stays below this.
_FEW_DIGITS = 3e-3


def make_pose(R: ArrayLike | None = None, p: ArrayLike | None = None) -> Array:
    """Return the pose with rotation `R` (..., 3, 3) and translation `p` (..., 3) in metres."""
    rotation = np.eye(3) if R is None else np.asarray(R, dtype=float)
    translation = np.zeros(3) if p is None else np.asarray(p, dtype=float)
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    X = np.zeros((*batch, 4, 4))
    X[..., :3, :3] = rotation
    X[..., :3, 3] = translation
    X[..., 3, 3] = 1.0
    return X


def invert_pose(X_AB: ArrayLike) -> Array:
    """Return X_BA of shape (..., 4, 4)."""
    X = np.asarray(X_AB, dtype=float)
    R_BA = np.swapaxes(X[..., :3, :3], -1, -2)
    return make_pose(R_BA, -np.einsum("...ij,...j->...i", R_BA, X[..., :3, 3]))


def transform_points(X_AB: ArrayLike, p_BPs: ArrayLike) -> Array:
    """Return the points `p_BPs` (N, 3) of frame B in frame A, (..., N, 3)."""
    X = np.asarray(X_AB, dtype=float)
    points = np.asarray(p_BPs, dtype=float)
    return points @ np.swapaxes(X[..., :3, :3], -1, -2) + X[..., None, :3, 3]


def rotation_x(angle_rad: float) -> Array:
    """Return the (3, 3) rotation about x."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle_rad: float) -> Array:
    """Return the (3, 3) rotation about y."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle_rad: float) -> Array:
    """Return the (3, 3) rotation about z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_error_rad(R_A: ArrayLike, R_B: ArrayLike) -> Array:
    """Return the angle between rotations of shape (..., 3, 3), in [0, pi]; shapes broadcast."""
    trace = np.einsum("...ij,...ij->...", np.asarray(R_A, float), np.asarray(R_B, float))
    return np.asarray(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))


def rounded_poses(X: ArrayLike, position_decimals: int, rotation_decimals: int) -> Array:
    """Return poses (..., 4, 4) whose last digits no longer depend on how they were computed.

    Positions, in metres, and the first two columns of rotations are rounded; then the rotations are
    made orthonormal again (Gram and Schmidt).  Nothing but elementwise arithmetic is used, which
    gives the same bits on every processor.
    """
    poses = np.asarray(X, dtype=float)
    x, y = (np.round(poses[..., :3, axis], rotation_decimals) for axis in (0, 1))
    x = x / _norms(x)
    y = y - _dots(x, y) * x
    y = y / _norms(y)
    z = np.stack(
        [
            x[..., 1] * y[..., 2] - x[..., 2] * y[..., 1],
            x[..., 2] * y[..., 0] - x[..., 0] * y[..., 2],
            x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0],
        ],
        axis=-1,
    )
    p = np.round(poses[..., :3, 3], position_decimals)
    return make_pose(np.stack([x, y, z], axis=-1), p)


def _dots(a: Array, b: Array) -> Array:
    product = a * b
    return (product[..., 0] + product[..., 1] + product[..., 2])[..., None]


def _norms(vectors: Array) -> Array:
    return np.sqrt(_dots(vectors, vectors))


def check_poses(X: ArrayLike, name: str) -> Array:
    """Return `X` (..., 4, 4) as float64, or raise ValueError naming `name` and what is wrong."""
    poses = np.asarray(X, dtype=float)
    if poses.ndim < 2 or poses.shape[-2:] != (4, 4):
        raise ValueError(f"{name} has shape {poses.shape}; expected (..., 4, 4)")
    if not np.isfinite(poses).all():
        raise ValueError(f"{name} holds NaN or infinite values; expected finite poses")
    if np.abs(poses[..., 3, :] - (0.0, 0.0, 0.0, 1.0)).max(initial=0.0) > _ROTATION_TOLERANCE:
        raise ValueError(f"{name} has a last row other than (0, 0, 0, 1)")
    R = poses[..., :3, :3]
    error = _orthonormal_error(R)
    if error > _ROTATION_TOLERANCE:
        raise ValueError(
            f"the rotation of {name} is not orthonormal: |R R^T - I| reaches {error:.2g}, "
            f"expected at most {_ROTATION_TOLERANCE:g}"
        )
    if (np.linalg.det(R) < 0).any():
        raise ValueError(f"the rotation of {name} is a reflection: its determinant is -1, not 1")
    return poses


def nearest_pose(X: ArrayLike, name: str) -> Array:
    """Return the pose (4, 4) nearest to `X`, whose rotation was written with few digits.

    The rotation is the nearest one in the Frobenius norm (Schoenemann, "A generalized solution of
    the orthogonal Procrustes problem", 1966).  A warning says by how much an entry was changed.

    Raises ValueError where `X` is further from a pose than digits explain.
    """
    pose = np.array(X, dtype=float)
    if pose.shape != (4, 4):
        raise ValueError(f"{name} has shape {pose.shape}; expected (4, 4)")
    R = pose[:3, :3]
    if np.isfinite(pose).all() and _ROTATION_TOLERANCE < _orthonormal_error(R) < _FEW_DIGITS:
        u, _, vt = np.linalg.svd(R)
        changed = np.abs(u @ vt - R).max()
        pose[:3, :3] = u @ vt
        warnings.warn(
            f"the rotation of {name} is not orthonormal; its entries were changed by up to "
            f"{changed:.1g} (were they written with few digits?)",
            stacklevel=2,
        )
    return check_poses(pose, name)


def _orthonormal_error(R: Array) -> float:
    return float(np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0))
