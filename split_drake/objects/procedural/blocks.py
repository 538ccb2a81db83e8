"""Convex kinds without round walls: boxes and what is like them."""

import numpy as np

from split_drake.objects.procedural.kinds import kind
from split_drake.objects.procedural.shape import Shape, circle, cuboid, hull, superellipsoid


@kind("box")
def box(rng: np.random.Generator) -> Shape:
    """Standing, up to 14 cm tall."""
    return cuboid((rng.uniform(0.02, 0.068), rng.uniform(0.025, 0.09), rng.uniform(0.03, 0.14)))


@kind("slab", "flat")
def slab(rng: np.random.Generator) -> Shape:
    """Lying or on edge, as a book would."""
    edges = [rng.uniform(0.045, 0.10), rng.uniform(0.05, 0.14), rng.uniform(0.010, 0.03)]
    return cuboid(edges if rng.random() < 0.6 else edges[::-1])


@kind("stick", "long")
def stick(rng: np.random.Generator) -> Shape:
    """Lying along x, with four or six edges."""
    section = circle(rng.uniform(0.008, 0.017), int(rng.choice([4, 6])))
    section = section * (1.0, rng.uniform(0.7, 1.3))
    length = rng.uniform(0.085, 0.15)
    ends = [np.column_stack([np.full(len(section), x), section]) for x in (0.0, length)]
    return hull(np.vstack(ends))


@kind("wedge")
def wedge(rng: np.random.Generator) -> Shape:
    """A triangular prism on one of its faces, its ridge along y."""
    width, height = rng.uniform(0.03, 0.08), rng.uniform(0.025, 0.07)
    depth, ridge = rng.uniform(0.03, 0.074), rng.uniform(0.0, 1.0) * width
    profile = np.array([(0.0, 0.0), (width, 0.0), (ridge, height)])
    sides = [np.insert(profile, 1, y, axis=1) for y in (0.0, depth)]
    return hull(np.vstack(sides))


@kind("pyramid")
def pyramid(rng: np.random.Generator) -> Shape:
    """A frustum on four to six corners."""
    count, radius = int(rng.integers(4, 7)), rng.uniform(0.025, 0.05)
    top, height = radius * rng.uniform(0.3, 0.9), rng.uniform(0.03, 0.10)
    rings = [
        np.column_stack([circle(r, count), np.full(count, z)])
        for r, z in ((radius, 0.0), (top, height))
    ]
    return hull(np.vstack(rings))


@kind("superquadric", "round")
def superquadric(rng: np.random.Generator) -> Shape:
    """Anything between a block, an egg and a spindle."""
    half_axes = (rng.uniform(0.014, 0.036), rng.uniform(0.018, 0.05), rng.uniform(0.018, 0.065))
    return superellipsoid(half_axes, rng.uniform(0.2, 1.3), rng.uniform(0.2, 1.3))


@kind("rock")
def rock(rng: np.random.Generator) -> Shape:
    """The convex hull of points on an ellipsoid."""
    points = rng.normal(size=(int(rng.integers(9, 22)), 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return hull(
        points * (rng.uniform(0.018, 0.036), rng.uniform(0.022, 0.05), rng.uniform(0.02, 0.05))
    )


@kind("bevelled_block")
def bevelled_block(rng: np.random.Generator) -> Shape:
    """A box with all edges cut off, as a die or a bar of soap."""
    edges = np.array([rng.uniform(0.025, 0.068), rng.uniform(0.03, 0.09), rng.uniform(0.02, 0.06)])
    cut = rng.uniform(0.1, 0.3) * edges.min()
    corners = []
    for axis in range(3):
        inset = np.full(3, 2.0 * cut)
        inset[axis] = 0.0
        corners.append(
            np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3) * (edges - inset)
        )
    return hull(np.vstack(corners))
