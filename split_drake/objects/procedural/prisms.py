"""Kinds that are an outline of the plane, made thick."""

import itertools
from collections.abc import Sequence

import manifold3d
import numpy as np
import shapely
from numpy.typing import ArrayLike

from split_drake.objects.procedural.kinds import kind
from split_drake.objects.procedural.shape import BULGE_M, Shape, as_mesh, bulge_m, circle, moved
from split_drake.poses import Array, make_pose, rotation_x


def extruded(rings: Sequence[ArrayLike], height: float) -> Shape:
    """Return a polygon, made `height` thick from z = 0 up.

    Args:
        rings: (N, 2) corners of its outline, then of each of its holes.
    """
    outline, *holes = (np.asarray(ring, dtype=float) for ring in rings)
    polygon = shapely.geometry.polygon.orient(shapely.Polygon(outline, holes))
    loops = [np.asarray(loop.coords)[:-1] for loop in (polygon.exterior, *polygon.interiors)]
    solid = manifold3d.Manifold.extrude(manifold3d.CrossSection(loops), height)
    return Shape(as_mesh(solid), tuple(_prism(part, height) for part in convex_parts(loops)))


def convex_parts(loops: Sequence[Array]) -> list[Array]:
    """Return nearly convex polygons (M, 2) that a polygon is put together from.

    Triangles that share an edge are merged for as long as what comes of it is nearly convex
    (Hertel and Mehlhorn 1983).

    Args:
        loops: (N, 2) corners of its outline, counterclockwise, and of its holes, clockwise.
    """
    corners = np.vstack(loops)
    triangles = manifold3d.triangulate([np.asarray(loop) for loop in loops])
    parts = [shapely.Polygon(corners[triangle]) for triangle in triangles]
    merged = True
    while merged:
        merged = False
        for i, j in itertools.combinations(range(len(parts)), 2):
            both = _joined(parts[i], parts[j])
            if both is not None:
                parts[i], merged = both, True
                del parts[j]
                break
    return [np.asarray(part.exterior.coords)[:-1] for part in parts]


def _joined(first: shapely.Polygon, second: shapely.Polygon) -> shapely.Polygon | None:
    """Return two polygons as one; None where they share no edge, or it would not be convex."""
    if not first.touches(second) or first.intersection(second).length < 1e-9:
        return None
    both = first.union(second)
    if both.geom_type != "Polygon" or both.interiors:
        return None
    return both if bulge_m(np.asarray(both.exterior.coords)) < BULGE_M else None


def _prism(polygon: Array, height: float) -> Array:
    return np.vstack([np.insert(polygon, 2, z, axis=1) for z in (0.0, height)])


def _either_way_up(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return the shape lying, or one time in three on edge."""
    return shape if rng.random() < 0.67 else moved(shape, make_pose(rotation_x(np.pi / 2.0)))


@kind("l_block")
def l_block(rng: np.random.Generator) -> Shape:
    """Two bars that meet at their ends."""
    a, b = rng.uniform(0.05, 0.11), rng.uniform(0.05, 0.10)
    s, t = rng.uniform(0.015, 0.035), rng.uniform(0.015, 0.035)
    outline = [(0, 0), (a, 0), (a, t), (s, t), (s, b), (0, b)]
    return _either_way_up(extruded([outline], rng.uniform(0.018, 0.05)), rng)


@kind("t_block")
def t_block(rng: np.random.Generator) -> Shape:
    """A bar across the end of another."""
    a, b = rng.uniform(0.05, 0.11), rng.uniform(0.05, 0.11)
    s, t = rng.uniform(0.015, 0.03), rng.uniform(0.015, 0.03)
    outline = [
        *((-s / 2, 0), (s / 2, 0), (s / 2, b - t), (a / 2, b - t)),
        *((a / 2, b), (-a / 2, b), (-a / 2, b - t), (-s / 2, b - t)),
    ]
    return _either_way_up(extruded([outline], rng.uniform(0.018, 0.045)), rng)


@kind("u_block", "hollow")
def u_block(rng: np.random.Generator) -> Shape:
    """A channel between two walls."""
    a, b, t = rng.uniform(0.05, 0.10), rng.uniform(0.03, 0.08), rng.uniform(0.010, 0.016)
    outline = [(0, 0), (a, 0), (a, b), (a - t, b), (a - t, t), (t, t), (t, b), (0, b)]
    return _either_way_up(extruded([outline], rng.uniform(0.02, 0.06)), rng)


@kind("regular_prism", "flat")
def regular_prism(rng: np.random.Generator) -> Shape:
    """Five to eight corners."""
    corners = circle(rng.uniform(0.02, 0.045), int(rng.integers(5, 9)))
    return extruded([corners], rng.uniform(0.012, 0.06))


@kind("cookie", "flat")
def cookie(rng: np.random.Generator) -> Shape:
    """An outline at random, with dents, around its middle."""
    count = int(rng.integers(6, 11))
    angle = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    radius = rng.uniform(0.55, 1.0, count) * rng.uniform(0.035, 0.06)
    outline = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return _either_way_up(extruded([outline], rng.uniform(0.014, 0.04)), rng)


@kind("star", "flat")
def star(rng: np.random.Generator) -> Shape:
    """Four to seven points."""
    count = int(rng.integers(4, 8))
    outline = circle(rng.uniform(0.03, 0.055), 2 * count)
    outline[1::2] *= rng.uniform(0.45, 0.75)
    return _either_way_up(extruded([outline], rng.uniform(0.014, 0.035)), rng)


@kind("nut", "hollow", "flat")
def nut(rng: np.random.Generator) -> Shape:
    """A prism on six or eight corners with a round hole."""
    count, radius = int(rng.choice([6, 8])), rng.uniform(0.025, 0.045)
    hole = circle(radius * rng.uniform(0.4, 0.65), 24)
    return extruded([circle(radius, count), hole], rng.uniform(0.015, 0.04))
