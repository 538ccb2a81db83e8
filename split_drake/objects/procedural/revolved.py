"""Solids of revolution about z, full and hollow, cut into convex pieces by sectors and stretches.

A profile is (N, 2): radius and height, metres.
"""

from collections.abc import Sequence

import manifold3d
import numpy as np
import shapely
from numpy.typing import ArrayLike

from split_drake.objects.procedural.shape import BULGE_M, FACETS, Shape, as_mesh, bulge_m
from split_drake.poses import Array

_SECTORS = (8, 12, 16, 24, 48)
# Full pieces have so many times fewer facets than meshes: nothing in contact resists rolling but
# edges, and with all of them, what is round would roll for seconds.
_COARSER = 2


def turned(profile: ArrayLike) -> Shape:
    """Return the solid within a profile, from its foot to its top."""
    outer = np.asarray(profile, dtype=float)
    inner = outer * (0.0, 1.0)
    outline = np.vstack([outer, inner[[-1, 0]]])
    return revolved(outline, _stretches(outer, inner))


def vessel(profile: ArrayLike, wall_m: float) -> Shape:
    """Return a wall of even thickness along the inside of a profile.

    The profile begins on the axis, with the foot's underside, and ends at the rim.
    """
    outer = np.asarray(profile, dtype=float)
    inner = _offset(outer, wall_m)
    inner[0, 0] = 0.0
    return revolved(np.vstack([outer, inner[::-1]]), _stretches(outer, inner))


def sleeve(profile: ArrayLike, wall_m: float) -> Shape:
    """Return a wall of even thickness along the inside of a profile that is open at both ends."""
    outer = np.asarray(profile, dtype=float)
    inner = _offset(outer, wall_m)
    return revolved(np.vstack([outer, inner[::-1]]), _stretches(outer, inner))


def ring(section: ArrayLike) -> Shape:
    """Return a convex cross-section (N, 2), radius and height of its corners, all around z."""
    corners = np.asarray(section, dtype=float)
    return revolved(corners, [corners])


def revolved(outline: Array, sections: Sequence[Array]) -> Shape:
    """Return what an outline (N, 2) encloses all around z.

    Args:
        sections: convex polygons (M, 2) that together fill the outline; each becomes one piece
            where it reaches the axis, and else a ring of pieces.
    """
    closed = shapely.geometry.polygon.orient(shapely.Polygon(outline))
    corners = np.asarray(closed.exterior.coords)[:-1]
    solid = manifold3d.Manifold.revolve(manifold3d.CrossSection([corners]), FACETS)
    hulls = tuple(piece for section in sections for piece in _around(section))
    return Shape(as_mesh(solid), hulls)


def _offset(profile: Array, wall_m: float) -> Array:
    """Return the profile moved inwards by `wall_m`, mitred, its ends square to it."""
    along = np.diff(profile, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    before, after = np.vstack([normals[:1], normals]), np.vstack([normals, normals[-1:]])
    miter = (before + after) / (1.0 + np.einsum("ni,ni->n", before, after))[:, None]
    return profile + wall_m * miter


def _stretches(outer: Array, inner: Array) -> list[Array]:
    """Return convex polygons between two polylines (N, 2) of as many points, as long as may be."""
    sections, start = [], 0
    while start < len(outer) - 1:
        end = start + 1
        while end + 1 < len(outer) and bulge_m(_between(outer, inner, start, end + 1)) < BULGE_M:
            end += 1
        sections.append(_between(outer, inner, start, end))
        start = end
    return sections


def _between(outer: Array, inner: Array, start: int, end: int) -> Array:
    return np.vstack([outer[start : end + 1], inner[start : end + 1][::-1]])


def _around(section: Array) -> list[Array]:
    """Return the pieces (M, 3) of a convex section (N, 2) revolved about z."""
    angle = 2.0 * np.pi * np.arange(FACETS) / FACETS
    radial = np.column_stack([np.cos(angle), np.sin(angle)])
    radius, height = section.T
    rings = np.concatenate(
        [
            radius[None, :, None] * radial[:, None],
            np.broadcast_to(height[None, :, None], (FACETS, len(section), 1)),
        ],
        axis=-1,
    )
    if radius.min() < BULGE_M:
        return [rings[::_COARSER].reshape(-1, 3)]
    # The inner side of a sector is flat: it bulges into the hole by its sagitta.
    fine = [n for n in _SECTORS if radius.max() * (1.0 - np.cos(np.pi / n)) < BULGE_M]
    step = FACETS // (fine or _SECTORS[-1:])[0]
    closed = np.concatenate([rings, rings[:1]])
    return [closed[at : at + step + 1].reshape(-1, 3) for at in range(0, FACETS, step)]
