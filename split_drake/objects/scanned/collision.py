"""Collision geometry fitted to a mug's mesh: what `mugs.collision` builds, from measurements."""

from itertools import pairwise

import numpy as np

from split_drake.objects.collision_pieces import capsule, ring_of_boxes
from split_drake.objects.mugs.collision import (
    BOXES_PER_RING,
    HANDLE_TOLERANCE_M,
    MAX_HANDLE_SEGMENTS,
    WALL_TOLERANCE_M,
    simplify_path,
)
from split_drake.objects.rigid import Primitive
from split_drake.objects.scanned.handle import Grip
from split_drake.objects.scanned.profile import BodyProfile
from split_drake.poses import Array, make_pose

# Thinner walls would let the pads' spheres through.
MIN_WALL_M = 0.002
# A cross-section this much longer than wide is still round.
_ROUND_ASPECT = 1.1
# Capsules side by side are this many radii apart at most, so that dents stay below 0.25 radii.
_ROW_SPACING = 1.3


def wall_boxes(profile: BodyProfile) -> list[Primitive]:
    """Return the wall's boxes, one ring for each straight stretch of the profile."""
    corners = simplify_path(_outline(profile), WALL_TOLERANCE_M, max(BOXES_PER_RING))
    count = BOXES_PER_RING[len(corners) - 1]
    return [
        box
        for lower, upper in pairwise(corners)
        for box in ring_of_boxes(lower, upper, _wall(profile, lower, upper), count)
    ]


def _outline(profile: BodyProfile) -> Array:
    """Return (N, 2) radius and height along the outside, from the table to the rim.

    Where the body narrows from the base up, it starts high enough for the boxes' inner corners,
    which point down, to clear the table.
    """
    z = np.r_[0.0, profile.heights_m, profile.height_m]
    radius = profile.outer_radius_m(z)
    inset = (radius[0] - np.interp(profile.height_m / 4.0, z, radius)) / (profile.height_m / 4.0)
    lowest = max(0.0, float(inset)) * profile.wall_m[0]
    kept = z > lowest
    start = [[profile.outer_radius_m(np.array(lowest)), lowest]]
    return np.vstack([start, np.column_stack([radius, z])[kept]])


def _wall(profile: BodyProfile, lower: Array, upper: Array) -> float:
    """Return the thickness across the wall of the stretch between two corners (r, z).

    Its upper half counts, which fingers reach: whatever fills the cavity's lower part must not
    thicken the rim.
    """
    z = np.linspace((lower[1] + upper[1]) / 2.0, upper[1], 20)
    level = np.median(np.interp(z, profile.heights_m, profile.wall_m))
    rise = (upper[1] - lower[1]) / np.linalg.norm(upper - lower)
    return max(MIN_WALL_M, float(level * rise))


def base_cylinder(profile: BodyProfile) -> Primitive:
    """Return the base, up to the cavity's floor, as wide as the body where it stands."""
    thickness = max(MIN_WALL_M, profile.floor_m)
    return Primitive(
        "cylinder", (float(profile.outer_m[0]), thickness), make_pose(p=(0.0, 0.0, thickness / 2.0))
    )


def handle_capsules(grip: Grip, profile: BodyProfile) -> list[Primitive]:
    """Return chains of capsules along the grip, side by side where it is wider than thick.

    A cross-section is taken for a stadium, along y or across the path in the plane of x and z.
    """
    kept = _clear_of_cavity(grip, profile)
    corners = simplify_path(grip.path[kept], HANDLE_TOLERANCE_M, MAX_HANDLE_SEGMENTS)
    at = [int(np.flatnonzero((grip.path == corner).all(axis=1))[0]) for corner in corners]
    return [piece for a, b in pairwise(at) for piece in _segment(grip, a, b)]


def _clear_of_cavity(grip: Grip, profile: BodyProfile) -> slice:
    """Return the stretch of the grip whose round ends do not reach through the wall."""
    x, z = grip.path.T
    inner = profile.outer_radius_m(z) - np.interp(z, profile.heights_m, profile.wall_m)
    clear = np.flatnonzero(x - _radii(grip) > inner)
    return slice(int(clear[0]), int(clear[-1]) + 1)


def _radii(grip: Grip) -> Array:
    """Return (N,) half the shorter side of the cross-sections."""
    return np.minimum(grip.thickness_m, grip.upper_y_m - grip.lower_y_m) / 2.0


def _segment(grip: Grip, a: int, b: int) -> list[Primitive]:
    """Return the capsules, side by side, that stand for the grip from cross-section a to b."""
    between = slice(a, b + 1)
    thickness = float(grip.thickness_m[between].mean())
    width = float((grip.upper_y_m - grip.lower_y_m)[between].mean())
    short, long = sorted((thickness, width))
    p_OA, p_OB = _middle(grip, a), _middle(grip, b)
    if long < _ROUND_ASPECT * short:
        return [capsule(p_OA, p_OB, (short + long) / 4.0)]
    along = (p_OB - p_OA) / np.linalg.norm(p_OB - p_OA)
    side = np.array([0.0, 1.0, 0.0])
    if thickness > width:
        side = np.cross(along, side)
    rows = 1 + int(np.ceil((long - short) / (_ROW_SPACING * short / 2.0)))
    offsets = np.linspace(-0.5, 0.5, rows)[:, None] * (long - short) * side
    return [capsule(p_OA + offset, p_OB + offset, short / 2.0) for offset in offsets]


def _middle(grip: Grip, index: int) -> Array:
    """Return (3,) the middle of a cross-section."""
    x, z = grip.path[index]
    return np.array([x, (grip.lower_y_m[index] + grip.upper_y_m[index]) / 2.0, z])


def fit_collision(profile: BodyProfile, grip: Grip) -> tuple[Primitive, ...]:
    """Return convex pieces in O that stand for a mug with this body and handle."""
    return (*wall_boxes(profile), base_cylinder(profile), *handle_capsules(grip, profile))
