"""Convex collision pieces: made of points, cut so that bodies rest, and drawn as meshes."""

from collections.abc import Iterable, Sequence

import manifold3d
import numpy as np
import trimesh

from split_drake.objects.rigid import Primitive, is_flat
from split_drake.poses import Array

# Bodies of more pieces than this stand on several of them, unless one is as large as they are.
_FEW_PIECES = 8
# Halves of a piece shorter than this would support it no better than the whole.
_MIN_CUT_M = 0.015
# Along an axis, a piece with more than such a share of the body's extent is wide, or long.
_WIDE_SHARE = 0.25
_LONG_SHARE = 0.5


def convex_piece(p_OVs: Array) -> Primitive:
    """Return the convex hull of points (N, 3) of O as a collision piece, inner points left out.

    Raises ValueError where the points span no volume.
    """
    points = np.asarray(p_OVs, dtype=float)
    hull = _vertices(manifold3d.Manifold.hull_points(points))
    return Primitive("convex", (), np.eye(4), hull if len(hull) else points)


def _vertices(solid: manifold3d.Manifold) -> Array:
    return np.array(solid.to_mesh64().vert_properties[:, :3])


def pieces_that_rest(hulls_O: Sequence[Array]) -> tuple[Primitive, ...]:
    """Return the convex hulls of point sets (N, 3) of O as pieces that let the body come to rest.

    Point contact knows one point per pair of pieces.  A body of one piece would stand on a single
    point that wanders over its foot: it rocks and creeps.  Pieces are therefore cut in halves
    along axes of O: all of them where a body has few, and else those that it would stand on alone,
    as on the floor of a bowl, or lie on alone, as on one stave of a tube.
    """
    extent, few = np.ptp(np.vstack(hulls_O), axis=0), len(hulls_O) <= _FEW_PIECES
    parts = []
    for hull in hulls_O:
        size = np.ptp(hull, axis=0)
        wide = few or np.sum((size > _MIN_CUT_M) & (size > _WIDE_SHARE * extent)) > 1
        shortest = 0.0 if wide else _LONG_SHARE * extent
        axes = np.flatnonzero((size > _MIN_CUT_M) & (size > shortest))
        parts += _cut_in_halves(hull, axes.tolist())
    return tuple(Primitive("convex", (), np.eye(4), part) for part in parts)


def _cut_in_halves(p_OVs: Array, axes: Iterable[int]) -> list[Array]:
    """Return the vertices (M, 3) of the parts of the convex hull of points, halved along axes."""
    middle = (p_OVs.min(axis=0) + p_OVs.max(axis=0)) / 2.0
    parts = [manifold3d.Manifold.hull_points(p_OVs)]
    for axis in axes:
        normal = np.eye(3)[axis]
        parts = [half for part in parts for half in part.split_by_plane(normal, middle[axis])]
    cut = [_vertices(part) for part in parts if not part.is_empty()]
    # A cut beside a corner leaves a sliver, which bears nothing.
    return [part for part in cut if not is_flat(part)]


def piece_mesh(piece: Primitive) -> trimesh.Trimesh:
    """Return a collision piece as a convex mesh in O, round ones by facets."""
    if piece.kind == "convex":
        mesh = trimesh.convex.convex_hull(piece.p_PVs)
    elif piece.kind == "box":
        mesh = trimesh.creation.box(piece.size)
    elif piece.kind == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=piece.size[0])
    elif piece.kind == "cylinder":
        mesh = trimesh.creation.cylinder(*piece.size, sections=48)
    else:
        mesh = trimesh.creation.capsule(radius=piece.size[0], height=piece.size[1])
    return mesh.apply_transform(piece.X_OP)
