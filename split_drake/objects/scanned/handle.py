"""The handle of a mug, measured on its mesh: the opening's outline and the grip around it.

Everything is found by rays, so a mesh may have gaps, inner surfaces and parts that overlap.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.ray_caster import RayCaster
from split_drake.objects.scanned.profile import BodyProfile
from split_drake.poses import Array

# A peg of 6 mm radius through the middle of an opening wants this much room around its axis.
PEG_ROOM_M = 0.007

# This share of the rays from an opening's middle may leave through gaps.
MAX_OPENING_GAPS = 0.25
# Thinner grips would slip between what represents them.
MIN_GRIP_M = 0.002

CELL_M = 0.0005
_MARGIN_M = 0.005
_FAR_M = 0.3
# CAD models have vertices in the plane y = 0; rays beside it don't slip between their triangles.
_ASIDE_M = 1e-5
_OUTLINE_RAYS = 240
# Of so many rays side by side most meet the handle; those that go this much farther did not.
_GAP_RAYS = 31
_BEHIND_M = 0.003
_SWEEP_STEP_RAD = np.radians(2.0)


@dataclass(frozen=True)
class Silhouette:
    """What one sees of a mug along y of O, as cells of `CELL_M` in the plane of x and z.

    Attributes:
        p_OFirst: (2,) x and z of the middle of cell (0, 0).
        opening: (X, Z) cells of the handle's opening.
        outside: (X, Z) other cells that one sees through.
    """

    p_OFirst: Array
    opening: NDArray[np.bool_]
    outside: NDArray[np.bool_]

    def p_OMiddle(self) -> Array:
        """Return (2,) x and z of the cell that is farthest from the opening's edge."""
        room = ndimage.distance_transform_edt(self.opening)
        return self.p_OFirst + CELL_M * np.array(np.unravel_index(room.argmax(), room.shape))

    def room_m(self, p_O: Array) -> float:
        """Return how far x and z `p_O` (2,) lie from the opening's edge, 0 outside of it."""
        room = ndimage.distance_transform_edt(self.opening)
        x, z = np.round((p_O - self.p_OFirst) / CELL_M).astype(int)
        inside = 0 <= x < room.shape[0] and 0 <= z < room.shape[1]
        return CELL_M * float(room[x, z]) if inside else 0.0


@dataclass(frozen=True)
class Grip:
    """The handle's grip along its centreline, from the lower to the upper root, N cross-sections.

    Attributes:
        path: (N, 2) x and z of O.
        thickness_m: (N,) in the plane of x and z, across the path.
        lower_y_m: (N,) where the surface at the path starts along y.
        upper_y_m: (N,) where it ends.
    """

    path: Array
    thickness_m: Array
    lower_y_m: Array
    upper_y_m: Array


def see_through(mesh: trimesh.Trimesh, body_radius_m: float = 0.0) -> Silhouette:
    """Return the silhouette of a mug's mesh, given in O; openings nearer to z than a radius aside.

    Raises InvalidMugError where it has not exactly one opening that a peg could pass.
    """
    lower = np.array([0.0, -_MARGIN_M])
    upper = mesh.bounds[1, [0, 2]] + _MARGIN_M
    x, z = (np.arange(a, b, CELL_M) for a, b in zip(lower, upper, strict=True))
    cells = np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)
    distances = _along_y(RayCaster(mesh), cells.reshape(-1, 2), 1.0)
    regions, _ = ndimage.label(np.isinf(distances).reshape(cells.shape[:2]))
    # Cell (0, -1) lies above the rim.
    outside = regions == regions[0, -1]
    sizes = np.bincount(regions[~outside])
    sizes[0] = 0
    # What one sees through the body, by gaps on both sides, is no handle's.
    middles = ndimage.mean(cells[..., 0], regions, np.arange(len(sizes)))
    sizes[middles < body_radius_m] = 0
    openings = np.flatnonzero(sizes * CELL_M**2 > np.pi * PEG_ROOM_M**2)
    if len(openings) != 1:
        raise InvalidMugError(
            f"no single opening: seen from the side, {len(openings)} are wide enough for a peg, "
            "expected one"
        )
    return Silhouette(lower, regions == openings[0], outside)


def _along_y(caster: RayCaster, p_Os: Array, sign: float) -> Array:
    """Return (N,) distances from y = -sign * `_FAR_M` to the mesh, along y, at x and z (N, 2)."""
    starts = np.insert(p_Os, 1, -sign * _FAR_M, axis=1)
    distances, _ = caster.cast(starts, np.broadcast_to((0.0, sign, 0.0), starts.shape))
    return distances.astype(float)


def cast_outline(mesh: trimesh.Trimesh, p_OMiddle: Array) -> Array:
    """Return (M, 3) the closed outline of the opening in the plane y = 0 of O.

    It is what a fan of rays meets from `p_OMiddle` (2,), x and z of a point in the opening.

    Raises InvalidMugError where rays leave through the handle.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, _OUTLINE_RAYS, endpoint=False)
    rays = np.column_stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)])
    start = np.array([p_OMiddle[0], _ASIDE_M, p_OMiddle[1]])
    distances = RayCaster(mesh).cast(start, rays)[0].astype(float)
    missed = float(np.isinf(distances).mean())
    if missed > MAX_OPENING_GAPS:
        raise InvalidMugError(
            f"open handle: {missed:.0%} of the rays from the middle of its opening leave through "
            f"it, expected at most {MAX_OPENING_GAPS:.0%}"
        )
    if missed > 0.0:
        distances = _without_gaps(distances)
    outline = start * (1.0, 0.0, 1.0) + distances[:, None] * rays
    return np.vstack([outline, outline[:1]])


def _without_gaps(distances: Array) -> Array:
    """Return (N,) distances of a fan of rays, those that went through gaps as their neighbours.

    Where some left through gaps (inf), others met what lies behind one.
    """
    number, met = np.arange(len(distances)), np.isfinite(distances)
    filled = np.interp(number, number[met], distances[met], period=len(number))
    usual = ndimage.median_filter(filled, _GAP_RAYS, mode="wrap")
    return np.where(filled > usual + _BEHIND_M, usual, filled)


def measure_grip(mesh: trimesh.Trimesh, silhouette: Silhouette, profile: BodyProfile) -> Grip:
    """Return the grip of a mug's mesh, given in O, as far as it lies outside the body.

    Its centreline is what lies as far from the opening as from the outside.

    Raises InvalidMugError where nothing around the opening lies outside the body.
    """
    to_opening = ndimage.distance_transform_edt(~silhouette.opening) * CELL_M
    to_outside = ndimage.distance_transform_edt(~silhouette.outside) * CELL_M
    path = _centerline(to_opening - to_outside, silhouette)
    path = _outside_body(path, profile)
    if len(path) < 2:
        raise InvalidMugError("no grip: what surrounds the opening does not leave the body")
    at = (path - silhouette.p_OFirst).T / CELL_M
    # Both distances end at cells' middles, half a cell beyond the edge.
    thickness = ndimage.map_coordinates(to_opening + to_outside, at, order=1) - CELL_M
    caster = RayCaster(mesh)
    from_below, from_above = (_along_y(caster, path, sign) for sign in (1.0, -1.0))
    met = np.isfinite(from_below) & np.isfinite(from_above)
    if met.sum() < 2:
        raise InvalidMugError(
            f"open handle: rays meet {met.sum()} of its {len(met)} cross-sections, expected 2"
        )
    lower, upper = from_below[met] - _FAR_M, _FAR_M - from_above[met]
    # Through a gap one meets the other side, and a sheet is as thin as it is drawn.
    thickness = np.maximum(thickness[met], MIN_GRIP_M)
    middle, half = (lower + upper) / 2.0, np.maximum((upper - lower) / 2.0, MIN_GRIP_M / 2.0)
    return Grip(path[met], thickness, middle - half, middle + half)


def _centerline(excess_m: Array, silhouette: Silhouette) -> Array:
    """Return (N, 2) x and z where `excess_m` (X, Z) rises through 0, from below to above.

    One looks from the opening's middle, from straight down over the handle's back to straight up
    and beyond, towards the body; directions in which it never rises are left out.
    """
    middle = silhouette.p_OMiddle()
    angle = np.arange(-0.8 * np.pi, 0.8 * np.pi, _SWEEP_STEP_RAD)
    reach = np.arange(0.0, max(excess_m.shape) * CELL_M, CELL_M / 2.0)
    rays = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = middle + reach[None, :, None] * rays[:, None]
    at = (points - silhouette.p_OFirst).transpose(2, 0, 1) / CELL_M
    values = ndimage.map_coordinates(excess_m, at, order=1, mode="constant", cval=np.nan)
    rises = (values[:, :-1] <= 0.0) & (values[:, 1:] > 0.0)
    found = rises.any(axis=1)
    first = rises.argmax(axis=1)[found]
    return points[found, first]


def _outside_body(path: Array, profile: BodyProfile) -> Array:
    """Return the stretch of the path about its outermost point that lies outside the body."""
    outside = path[:, 0] > profile.outer_radius_m(path[:, 1])
    outermost = int(path[:, 0].argmax())
    ends = np.flatnonzero(~outside)
    start = ends[ends < outermost].max(initial=-1) + 1
    stop = ends[ends > outermost].min(initial=len(path))
    return path[start:stop]
