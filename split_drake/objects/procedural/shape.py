"""Solids with their convex pieces: the blocks that kinds of shapes are put together from."""

from dataclasses import dataclass

import manifold3d
import numpy as np
import shapely
import trimesh
from numpy.typing import ArrayLike

from split_drake.poses import Array, transform_points

# How far the hull of a piece may bulge out of the solid that it stands for.
BULGE_M = 0.0008
# Facets around round solids; a multiple of every number of sectors that rings are cut into.
FACETS = 48
# Solids that only touch would stay apart.
OVERLAP_M = 5e-5


@dataclass(frozen=True)
class Shape:
    """A solid and what stands for it in contact, both in one frame, metres.

    Attributes:
        mesh: watertight.
        hulls: of each convex piece (N, 3) points; the pieces are their convex hulls.
    """

    mesh: trimesh.Trimesh
    hulls: tuple[Array, ...]


def as_manifold(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Return the mesh as a solid that booleans work on."""
    faces = np.asarray(mesh.faces, dtype=np.uint64)
    return manifold3d.Manifold(manifold3d.Mesh64(np.asarray(mesh.vertices), faces))


def as_mesh(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    """Return the surface of a solid."""
    surface = solid.to_mesh64()
    # Copies: views would keep manifold3d's mesh alive, which it complains of at the program's end.
    vertices, faces = np.array(surface.vert_properties[:, :3]), np.array(surface.tri_verts)
    return trimesh.Trimesh(vertices, faces, process=False)


def moved(shape: Shape, X_AB: Array) -> Shape:
    """Return the shape, given in B, in frame A."""
    mesh = trimesh.Trimesh(
        transform_points(X_AB, shape.mesh.vertices), shape.mesh.faces, process=False
    )
    return Shape(mesh, tuple(transform_points(X_AB, hull) for hull in shape.hulls))


def stretched(shape: Shape, factors: ArrayLike) -> Shape:
    """Return the shape stretched along x, y and z."""
    along = np.asarray(factors, dtype=float)
    mesh = trimesh.Trimesh(shape.mesh.vertices * along, shape.mesh.faces, process=False)
    return Shape(mesh, tuple(hull * along for hull in shape.hulls))


def union(*shapes: Shape) -> Shape:
    """Return the union of shapes, which should overlap and not just touch."""
    solids = [as_manifold(shape.mesh) for shape in shapes]
    solid = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    return Shape(as_mesh(solid), tuple(hull for shape in shapes for hull in shape.hulls))


def hull(p_OVs: ArrayLike) -> Shape:
    """Return the convex hull of points (N, 3)."""
    points = np.asarray(p_OVs, dtype=float)
    return Shape(as_mesh(manifold3d.Manifold.hull_points(points)), (points,))


def cuboid(edges: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Shape:
    """Return a box with edges along x, y and z."""
    corners = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
    return hull(corners * np.asarray(edges) + np.asarray(center))


def superellipsoid(half_axes: ArrayLike, vertical: float = 1.0, horizontal: float = 1.0) -> Shape:
    """Return a superellipsoid about the origin; exponents below 1 are boxy, 1 is an ellipsoid."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    height = np.linspace(-np.pi / 2.0, np.pi / 2.0, 17)
    theta, phi = (grid.ravel() for grid in np.meshgrid(azimuth, height))

    def power(value: Array, exponent: float) -> Array:
        return np.asarray(np.sign(value) * np.abs(value) ** exponent)

    level = power(np.cos(phi), vertical)
    x, y = level * power(np.cos(theta), horizontal), level * power(np.sin(theta), horizontal)
    return hull(np.column_stack([x, y, power(np.sin(phi), vertical)]) * np.asarray(half_axes))


def ball(radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> Shape:
    """Return a ball."""
    return hull(
        trimesh.creation.icosphere(subdivisions=2, radius=radius).vertices + np.asarray(center)
    )


def circle(radius: float, count: int = FACETS) -> Array:
    """Return the corners (N, 2) of a regular polygon about the origin, the first on the x axis."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rod(start: ArrayLike, end: ArrayLike, radius: float, end_radius: float | None = None) -> Shape:
    """Return a round rod, or a frustum, from one point (3,) to another."""
    p_start, p_end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    side = np.eye(3)[np.argmin(np.abs(p_end - p_start))]
    path = np.stack([p_start, p_end])
    ring = circle(1.0, FACETS // 2)
    return swept(path, ring, side, (radius, radius if end_radius is None else end_radius))


def swept(path: Array, ring: Array, side: ArrayLike, scales: ArrayLike | None = None) -> Shape:
    """Return a convex cross-section swept along a path, as a chain of convex hulls.

    Args:
        path: (N, 3) points of the centreline.
        ring: (M, 2) corners of the cross-section, across the path and along `side`.
        side: (3,) a direction that the path is nowhere parallel to.
        scales: (N,) factors of the cross-section along the path; 1 where left out.
    """
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.cross(np.asarray(side, dtype=float), tangents)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    beside = np.cross(tangents, across)
    factors = np.ones(len(path)) if scales is None else np.asarray(scales, dtype=float)
    corners = ring[None] * factors[:, None, None]
    rings = path[:, None] + corners[..., :1] * across[:, None] + corners[..., 1:] * beside[:, None]
    overlap = OVERLAP_M * tangents[:, None]
    links = [
        hull(np.vstack(pair))
        for pair in zip(rings[:-1] - overlap[:-1], rings[1:] + overlap[1:], strict=True)
    ]
    return links[0] if len(links) == 1 else union(*links)


def bulge_m(outline: Array) -> float:
    """Return how far the convex hull of a polygon (N, 2) reaches beyond it."""
    rim = shapely.Polygon(outline).convex_hull.exterior
    return float(shapely.distance(rim, shapely.points(outline)).max())
