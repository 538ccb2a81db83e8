"""The objects of a scene: connected parts of what is seen, and which of them a pose belongs to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from split_drake.poses import Array
from split_drake.scene import Scene, Voxels, farthest_points

# Points are gathered into voxels of this edge first.
VOXEL_M = 0.004
# Voxels with less than this share of the points that others have (median) connect nothing: flying
# pixels make bridges of such.
SPARSE = 0.25
# Voxels this close are parts of one object.
LINK_M = 0.016
# What an object hides of itself parts it.  So what has no more than such a share of the voxels of
# something so near is part of that.  Of 121 lone mugs that two cameras see, 10 are in pieces:
# of seven the lesser ones have up to 3% of the points, of three 5% to 11%; gaps are 2 to 20 mm.
# A lying mug's own body hides what joins it to a handle below: seen from above, the two touch.
# Three such mugs have 6% to 8% there, across gaps of 21 to 33 mm, of which 1 to 6 mm are level; one
# whose rim and handle are seen apart from the body, but joined, has 21% across 12 mm, none level.
ANYWHERE = np.inf
FRAGMENTS = ((0.05, 0.04, ANYWHERE), (0.20, 0.02, ANYWHERE), (0.30, 0.05, 0.008))
# What has fewer voxels than this is a speck and no object.
SPECK_VOXELS = 12


@dataclass(frozen=True)
class ObjectInView:
    """One object as far as it is seen.

    Attributes:
        points: (N,) which points of the cloud are its own.
        p_WPs: (M, 3) those, metres in W.
    """

    points: NDArray[np.bool_]
    p_WPs: Array


def objects_in_view(p_WPs: Array) -> list[ObjectInView]:
    """Return the objects that a cloud (N, 3) shows, that with the most points first.

    Objects that touch, or nearly do, are one; large parts of one that are seen apart are two.
    Specks belong to none.
    """
    if not len(p_WPs):
        return []
    voxels = Voxels.of(p_WPs, VOXEL_M)
    parts = _parts(voxels.middles, voxels.counts >= SPARSE * np.median(voxels.counts))
    part_of_point = parts[voxels.of_point]
    found = [
        ObjectInView(part_of_point == part, p_WPs[part_of_point == part])
        for part in range(parts.max() + 1)
        if (parts == part).sum() >= SPECK_VOXELS
    ]
    return sorted(found, key=lambda each: -len(each.p_WPs))


def _parts(middles: Array, solid: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return (N,) the part that each voxel is of, by its middle (N, 3); -1 for none.

    Those that are not `solid` (N,) go with the nearest one that is, and connect nothing.
    """
    parts = np.full(len(middles), -1)
    parts[solid] = _connected(middles[solid])
    near_m, nearest = cKDTree(middles[solid]).query(middles[~solid])
    parts[~solid] = np.where(near_m < LINK_M, parts[solid][nearest], -1)
    return _with_fragments(parts, middles)


def _with_fragments(parts: NDArray[np.intp], middles: Array) -> NDArray[np.intp]:
    """Return the parts (N,) of voxels, middles (N, 3), fragments joined to what they are of."""
    whole = parts.copy()
    sizes = np.bincount(parts[parts >= 0])
    # From the largest on, so that a fragment may be near another one of the same object.
    for part in np.argsort(-sizes, kind="stable"):
        for share, gap_m, level_m in FRAGMENTS:
            large = np.flatnonzero(np.bincount(whole[whole >= 0]) * share > sizes[part])
            larger = np.flatnonzero(np.isin(whole, large))
            near = _nearest(middles[larger], middles[parts == part], gap_m, level_m)
            if near is not None:
                whole[parts == part] = whole[larger[near]]
                break
    return whole


def _nearest(points: Array, others: Array, gap_m: float, level_m: float) -> int | None:
    """Return which of the points (N, 3) is nearest to any of the others (M, 3).

    None where that is no nearer than `gap_m`, or no two are nearer than `level_m` seen from above.
    """
    if not len(points) or _least_m(points[:, :2], others[:, :2]) >= level_m:
        return None
    near_m, nearest = (np.asarray(each) for each in cKDTree(points).query(others))
    return int(nearest[near_m.argmin()]) if near_m.min() < gap_m else None


def _least_m(points: Array, others: Array) -> float:
    """Return the least distance between points (N, D) and others (M, D)."""
    return float(np.min(cKDTree(points).query(others)[0]))


def _connected(points: Array) -> NDArray[np.intp]:
    """Return (N,) the number of the part that each of the points (N, 3) is of."""
    pairs = cKDTree(points).query_pairs(LINK_M, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs), bool), pairs.T), shape=(len(points),) * 2)
    _, parts = connected_components(links, directed=False)
    return np.asarray(parts)


def scenes_of_objects(scene: Scene) -> list[Scene]:
    """Return a scene of each object in view, of its points alone, and the scene where there is one.

    What a detector finds in it belongs to that object, and is found as if nothing stood beside it.
    """
    objects = objects_in_view(scene.p_WPs)
    if len(objects) < 2:
        return [scene]
    return [
        replace(scene, p_WPs=each.p_WPs, p_WSs=farthest_points(each.p_WPs, Scene.SAMPLED_POINTS))
        for each in objects
    ]


def owners(X_WPs: Array, objects: Sequence[ObjectInView]) -> NDArray[np.intp]:
    """Return (N,) the index of the object that each of the poses (N, 4, 4) belongs to.

    That is the one whose convex hull the pose's origin is deepest in, or else the nearest to: a
    grasp lies between two sides of what it takes, a handle's pose in the handle's opening, and an
    upright pose on the foot.

    Raises ValueError where there is no object.
    """
    if not objects:
        raise ValueError("there is no object for poses to belong to; expected one at least")
    outside = [_outside_m(X_WPs[:, :3, 3], each.p_WPs) for each in objects]
    return np.asarray(np.argmin(np.stack(outside), axis=0))


def _outside_m(p_WQs: Array, p_WPs: Array) -> Array:
    """Return (Q,) how far points (Q, 3) are outside the hull of points (N, 3); inside below 0.

    Outside it is the distance from the furthest of the hull's planes, which is no more than the
    distance from the hull.  What is flat, and has no hull, is as far as its nearest point.
    """
    try:
        planes = ConvexHull(p_WPs).equations
    except QhullError:
        return np.asarray(cKDTree(p_WPs).query(p_WQs)[0])
    return np.asarray((p_WQs @ planes[:, :3].T + planes[:, 3]).max(axis=1))
