"""Collision geometry of parametric mugs: rings of boxes, a base cylinder, chains of capsules."""

from itertools import pairwise

import numpy as np

from split_drake.objects.collision_pieces import capsule, ring_of_boxes
from split_drake.objects.mugs.mesh import handle_path
from split_drake.objects.mugs.parameters import MugParameters, outer_radius_m
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, make_pose

# Boxes around a ring, by the number of rings.  With fewer boxes mugs rest on edges they don't have.
BOXES_PER_RING = {1: 24, 2: 24, 3: 20, 4: 18}
WALL_TOLERANCE_M = 0.0006
MAX_HANDLE_SEGMENTS = 9
HANDLE_TOLERANCE_M = 0.0006


def _chord_errors(path: Array) -> Array:
    """Return (N, N): how far the points between i and j lie from the chord i-j at most."""
    count = len(path)
    errors = np.full((count, count), np.inf)
    for i in range(count - 1):
        for j in range(i + 1, count):
            chord = path[j] - path[i]
            offset = path[i : j + 1] - path[i]
            cross = chord[0] * offset[:, 1] - chord[1] * offset[:, 0]
            errors[i, j] = np.abs(cross).max() / np.linalg.norm(chord)
    return errors


def simplify_path(path: Array, tolerance_m: float, max_segments: int) -> Array:
    """Return the fewest of the points `path` (N, 2) that follow it within `tolerance_m`.

    Where `max_segments` do not suffice, return those with the least deviation.  Exact, by dynamic
    programming over the last point kept.
    """
    errors = _chord_errors(path)
    best = errors[0].copy()
    parents: list[np.ndarray] = []
    while best[-1] > tolerance_m and len(parents) + 1 < max_segments:
        through = np.maximum(best[:, None], errors)
        parents.append(through.argmin(axis=0))
        best = through.min(axis=0)
    kept = [len(path) - 1]
    for parent in reversed(parents):
        kept.append(int(parent[kept[-1]]))
    return path[[0, *reversed(kept)]]


def wall_boxes(parameters: MugParameters) -> list[Primitive]:
    """Return the wall's boxes, one ring for each straight stretch of the profile."""
    z = np.linspace(0.0, parameters.height_m, 30)
    outline = np.column_stack([outer_radius_m(parameters, z), z])
    corners = simplify_path(outline, WALL_TOLERANCE_M, max(BOXES_PER_RING))
    count = BOXES_PER_RING[len(corners) - 1]
    return [
        box
        for lower, upper in pairwise(corners)
        for box in ring_of_boxes(lower, upper, parameters.wall_m, count)
    ]


def base_cylinder(parameters: MugParameters) -> Primitive:
    """Return the base, as wide as the body where it stands on the table."""
    radius = float(outer_radius_m(parameters, 0.0))
    center = make_pose(p=(0.0, 0.0, parameters.base_m / 2.0))
    return Primitive("cylinder", (radius, parameters.base_m), center)


def _trim(path: Array, length_m: float) -> Array:
    """Return the polyline `path` (N, 2) without `length_m` at either end."""
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    kept = np.linspace(length_m, at[-1] - length_m, len(path))
    return np.column_stack([np.interp(kept, at, column) for column in path.T])


def handle_capsules(parameters: MugParameters) -> list[Primitive]:
    """Return chains of capsules along the handle, side by side where it is wider than thick."""
    radius = parameters.grip_thickness_m / 2.0
    aspect = parameters.grip_aspect
    rows = 1 if aspect < 1.1 else 2 if aspect < 1.6 else 3
    spread = radius * (aspect - 1.0)
    ys = np.linspace(-spread, spread, rows) if rows > 1 else np.zeros(1)
    # The path ends in the middle of the wall; a cap must not reach through it.
    path = _trim(handle_path(parameters), max(radius - parameters.wall_m / 2.0, 0.0))
    path = simplify_path(path, HANDLE_TOLERANCE_M, MAX_HANDLE_SEGMENTS)
    return [
        capsule(np.array([a[0], y, a[1]]), np.array([b[0], y, b[1]]), radius)
        for y in ys
        for a, b in pairwise(path)
    ]


def collision_geometry(parameters: MugParameters) -> tuple[Primitive, ...]:
    """Return convex pieces in O that agree with the mesh within about 1.5 mm."""
    return (
        *wall_boxes(parameters),
        base_cylinder(parameters),
        *handle_capsules(parameters),
    )
