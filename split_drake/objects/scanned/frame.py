"""The frame O of a mug's mesh: where its body's axis stands and where its handle points."""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.optimize import least_squares

from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array, invert_pose, make_pose, rotation_z

# What sticks out of the body by more than this belongs to the handle.
HANDLE_EXCESS_M = 0.006
# Out of round: the median deviation from a circle, over its radius, that a body may have.
MAX_OUT_OF_ROUND = 0.05
# This share of the body's sides may be gaps.
MAX_MISSING = 0.2
# The handle's azimuths must agree this well: 1 where all are the same, 0 where they are all around.
MIN_AGREEMENT = 0.8

_FAR_M = 0.5
_HEIGHTS = 40
_AZIMUTHS = 240
_DEVIATION_SCALE_M = 0.0005


def outer_radii(caster: RayCaster, p_Axis: Array, heights_m: Array, azimuths_rad: Array) -> Array:
    """Return (H, A) distances from a vertical axis at (x, y) `p_Axis` to the outermost surface.

    Rays run level towards the axis from afar, so nothing inside the mesh counts; NaN: nothing met.
    """
    z, azimuth = np.meshgrid(heights_m, azimuths_rad, indexing="ij")
    inward = -np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(z)], axis=-1).reshape(-1, 3)
    origins = np.r_[p_Axis, 0.0] - _FAR_M * inward
    origins[:, 2] = z.ravel()
    distances, _ = caster.cast(origins, inward)
    return np.where(distances < _FAR_M, _FAR_M - distances, np.nan).reshape(z.shape)


def find_frame(mesh: trimesh.Trimesh) -> Array:
    """Return X_FO (4, 4) of an upright mug whose mesh is given in a file's frame F, z up.

    O has its origin at the centre of the base, z up, and x towards the handle.  The body's axis is
    the one about which level sections are roundest; what sticks out of them is the handle.

    Raises InvalidMugError where the body isn't round about a vertical axis, or no single handle
    sticks out of it.
    """
    caster = RayCaster(mesh)
    lower, upper = mesh.bounds
    heights = lower[2] + (upper[2] - lower[2]) * (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS
    azimuths = np.linspace(-np.pi, np.pi, _AZIMUTHS, endpoint=False)
    p_Axis = (lower[:2] + upper[:2]) / 2.0
    # Rays towards the bounding box's middle crowd on one side; those of the second round do not.
    for _ in range(2):
        p_Axis = _roundest_axis(caster, p_Axis, heights, azimuths)
    radii = outer_radii(caster, p_Axis, heights, azimuths)
    radii = radii[np.isfinite(radii).any(axis=1)]
    _check_met(radii, azimuths)
    _check_round(radii)
    azimuth = _handle_azimuth(radii, azimuths)
    return make_pose(rotation_z(azimuth), (*p_Axis, lower[2]))


def into_frame(mesh: trimesh.Trimesh, X_FO: Array) -> trimesh.Trimesh:
    """Return a copy of a mesh in F, in O."""
    moved = mesh.copy()
    moved.apply_transform(invert_pose(X_FO))
    return moved


def _roundest_axis(
    caster: RayCaster, p_Axis: Array, heights_m: Array, azimuths_rad: Array
) -> Array:
    """Return (x, y) of the axis about which sections are roundest, whatever sticks out of them."""
    radii = outer_radii(caster, p_Axis, heights_m, azimuths_rad)
    # Levels that no ray meets say nothing.
    radii = radii[np.isfinite(radii).any(axis=1)]
    _check_met(radii, azimuths_rad)
    outward = np.stack([np.cos(azimuths_rad), np.sin(azimuths_rad)], axis=-1)
    points = p_Axis + radii[..., None] * outward

    def deviations(p_Candidate: Array) -> Array:
        distances = np.linalg.norm(points - p_Candidate, axis=-1)
        return (distances - np.nanmedian(distances, axis=1, keepdims=True))[np.isfinite(radii)]

    fit = least_squares(deviations, p_Axis, loss="cauchy", f_scale=_DEVIATION_SCALE_M)
    return np.asarray(fit.x)


def _excess(radii: Array) -> Array:
    """Return (H, A) how far the surface lies beyond its level's median radius; 0 where missing."""
    return np.nan_to_num(radii - np.nanmedian(radii, axis=1, keepdims=True))


def _check_met(radii: Array, azimuths_rad: Array) -> None:
    """Raise InvalidMugError where rays hardly meet anything."""
    if radii.size < _HEIGHTS * len(azimuths_rad) * (1.0 - MAX_MISSING):
        levels = len(radii) / _HEIGHTS
        raise InvalidMugError(
            f"open body: rays from the sides meet it at {levels:.0%} of its heights, expected at "
            f"least {1.0 - MAX_MISSING:.0%}"
        )


def _check_round(radii: Array) -> None:
    share = float(np.median(np.abs(_excess(radii))) / np.nanmedian(radii))
    if share > MAX_OUT_OF_ROUND:
        raise InvalidMugError(
            f"no upright round body: about its vertical axis the radius varies by {share:.0%}, "
            f"expected at most {MAX_OUT_OF_ROUND:.0%} of a mug with z up"
        )
    if np.isnan(radii).mean() > MAX_MISSING:
        raise InvalidMugError(
            f"open body: {np.isnan(radii).mean():.0%} of its sides are missing, expected at most "
            f"{MAX_MISSING:.0%}"
        )


def _handle_azimuth(radii: Array, azimuths_rad: Array) -> float:
    """Return the direction in which the surface sticks out of the body, in radians."""
    excess = _excess(radii)
    weights: NDArray[np.float64] = np.where(excess > HANDLE_EXCESS_M, excess, 0.0).sum(axis=0)
    if not weights.any():
        raise InvalidMugError(
            f"no handle: nothing sticks out of the body by more than {HANDLE_EXCESS_M} m"
        )
    mean = (weights * np.exp(1j * azimuths_rad)).sum() / weights.sum()
    if abs(mean) < MIN_AGREEMENT:
        raise InvalidMugError(
            f"no single handle: what sticks out of the body points {abs(mean):.0%} the same way, "
            f"expected at least {MIN_AGREEMENT:.0%}"
        )
    return float(np.angle(mean))
