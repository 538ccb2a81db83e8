"""The profile of a mug's body, measured on its mesh: radii inside and outside, and the floor."""

from dataclasses import dataclass

import numpy as np
import trimesh

from split_drake.objects.handle_points import HANDLE_AZIMUTH_RAD
from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.ray_caster import RayCaster
from split_drake.objects.scanned.frame import MAX_MISSING, outer_radii
from split_drake.poses import Array

# A cavity's floor must lie below this share of the height.
MAX_FLOOR = 0.5

_ROWS = 60
_AZIMUTHS = 60
# Heights keep this far from base and rim, where edges are rounded.
_EDGE_M = 0.0015
# Rays beside the axis, where revolved meshes have a corner, fall on the floor.
_FLOOR_GRID_M = np.linspace(-0.0051, 0.0049, 5)


@dataclass(frozen=True)
class BodyProfile:
    """A body of revolution about z of O.

    Attributes:
        heights_m: (N,) increasing, from just above the base to just below the rim.
        outer_m: (N,) outer radius there.
        wall_m: (N,) thickness of the wall, measured level; below the floor that of the wall there.
        floor_m: height of the cavity's floor.
        height_m: of the rim.
    """

    heights_m: Array
    outer_m: Array
    wall_m: Array
    floor_m: float
    height_m: float

    def outer_radius_m(self, z: Array) -> Array:
        """Return the outer radius at heights `z`, shape for shape."""
        return np.interp(z, self.heights_m, self.outer_m)


def measure_profile(mesh: trimesh.Trimesh) -> BodyProfile:
    """Return the profile of a mug's mesh, given in O; medians over all sides but the handle's.

    No number of it is NaN, whatever gaps the mesh has.

    Raises InvalidMugError where the mesh has no cavity that is open at the top, or hardly a wall.
    """
    caster, height = RayCaster(mesh), float(mesh.bounds[1, 2])
    floor = _floor_height(caster, height)
    heights = np.linspace(_EDGE_M, height - _EDGE_M, _ROWS)
    azimuths = np.linspace(HANDLE_AZIMUTH_RAD, 2.0 * np.pi - HANDLE_AZIMUTH_RAD, _AZIMUTHS)
    outer = _level_medians(outer_radii(caster, np.zeros(2), heights, azimuths), "outside")
    inside = heights > floor + _EDGE_M
    inner = _level_medians(_inner_radii(caster, heights[inside], azimuths), "inside")
    # A wall that is a single surface has no thickness; one measured through gaps has less.
    level = np.clip(outer[inside] - inner, 0.0, outer[inside])
    # Of the wall's thickness within the base nothing can be seen; it goes on as above.
    wall = np.interp(heights, heights[inside], level)
    return BodyProfile(heights, outer, wall, floor, height)


def _level_medians(radii: Array, side: str) -> Array:
    """Return (H,) the median of each row's finite radii (H, A); rows without go on as neighbours.

    Raises InvalidMugError where more than `MAX_MISSING` of the rows have none.
    """
    radii = np.where(np.isfinite(radii), radii, np.nan)
    found = np.isfinite(radii).any(axis=1)
    missing = 1.0 - float(found.mean())
    if missing > MAX_MISSING:
        raise InvalidMugError(
            f"open body: its wall is missing all around at {missing:.0%} of its heights, seen from "
            f"{side}, expected at most {MAX_MISSING:.0%}"
        )
    rows = np.arange(len(radii))
    return np.interp(rows, rows[found], np.nanmedian(radii[found], axis=1))


def _floor_height(caster: RayCaster, height_m: float) -> float:
    """Return the height of the cavity's floor, by rays that fall about the axis."""
    x, y = (grid.ravel() for grid in np.meshgrid(_FLOOR_GRID_M, _FLOOR_GRID_M))
    above = np.column_stack([x, y, np.full_like(x, 2.0 * height_m)])
    fallen, _ = caster.cast(above, np.broadcast_to((0.0, 0.0, -1.0), above.shape))
    met = fallen[np.isfinite(fallen)]
    if not len(met):
        raise InvalidMugError("no floor: from above one sees through the body, expected a cavity")
    floor = 2.0 * height_m - float(np.median(met))
    # A floor that is a single surface lies at 0, but for what numbers lose.
    if not -_EDGE_M <= floor < MAX_FLOOR * height_m:
        raise InvalidMugError(
            f"no cavity that opens upwards: from above one meets the mesh at {floor:.4f} m, "
            f"expected 0 to {MAX_FLOOR * height_m:.4f} m"
        )
    return max(0.0, floor)


def _inner_radii(caster: RayCaster, heights_m: Array, azimuths_rad: Array) -> Array:
    """Return (H, A) distances from the axis to the inside of the wall; inf: nothing met."""
    z, azimuth = np.meshgrid(heights_m, azimuths_rad, indexing="ij")
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(z)], axis=-1)
    p_OStarts = np.column_stack([np.zeros((z.size, 2)), z.ravel()])
    distances, _ = caster.cast(p_OStarts, outward.reshape(-1, 3))
    return distances.reshape(z.shape).astype(float)
