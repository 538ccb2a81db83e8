"""Perceived points against arm, hand and each other, for a batch of postures at once."""

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planning.collision.distances import arm_capsules, distance_to_segments, outside_box
from split_drake.poses import Array, invert_pose
from split_drake.robot.gripper import Box

# Each perceived point stands for a sphere of this radius: half the diagonal of the cloud's voxels
# within the surface.
POINT_RADIUS_M = 0.006

BoolArray = NDArray[np.bool_]


def posed(X_WFs: Array, p_FPs: Array) -> Array:
    """Return (B, N, 3): points (N, 3) of F for each of its poses (B, 4, 4)."""
    return p_FPs @ np.swapaxes(X_WFs[:, :3, :3], 1, 2) + X_WFs[:, None, :3, 3]


def hand_clear(X_WGs: Array, p_WPs: Array, boxes: Iterable[Box]) -> BoolArray:
    """Return (B,): whether boxes of the hand at X_WGs (B, 4, 4) are clear of points (N, 3)."""
    p_GPs = posed(invert_pose(X_WGs), p_WPs)
    clear = np.ones(len(X_WGs), dtype=bool)
    for box in boxes:
        outside = outside_box(p_GPs[clear], box)
        squared = np.einsum("...j,...j->...", outside, outside)
        clear[clear] = squared.min(axis=1, initial=np.inf) > POINT_RADIUS_M**2
    return clear


def arm_clear(X_WLs: Array, p_WPs: Array, last_link: int) -> BoolArray:
    """Return (B,): whether links 0 to `last_link` are clear of points (N, 3) or (B, N, 3), N > 0.

    Capsules that the points' bounding sphere shows to be far away are not looked at closer.

    Args:
        X_WLs: (B, 7, 4, 4) poses of links 1 to 7.
        p_WPs: points in W, the same for all postures or others for each.
        last_link: number of the last link that is looked at.
    """
    links, p_LEnds, radii = _capsules_up_to(last_link)
    X_W0s = np.broadcast_to(np.eye(4), (len(X_WLs), 1, 4, 4))
    X_WCs = np.concatenate([X_W0s, X_WLs], axis=1)[:, links]
    p_WEnds = p_LEnds @ np.swapaxes(X_WCs[..., :3, :3], -1, -2) + X_WCs[..., None, :3, 3]
    center = p_WPs.mean(axis=-2, keepdims=True)
    reach = np.linalg.norm(p_WPs - center, axis=-1).max(axis=-1)
    gaps = radii + POINT_RADIUS_M
    from_center = distance_to_segments(
        center[..., None, :, :], p_WEnds[..., 0, :], p_WEnds[..., 1, :]
    )[..., 0]
    near = from_center < np.asarray(reach)[..., None] + gaps
    clear = np.ones(len(X_WLs), dtype=bool)
    for index in np.flatnonzero(near.any(axis=0)):
        at = clear & near[:, index]
        if at.any():
            points = p_WPs[at] if p_WPs.ndim == 3 else p_WPs
            distances = distance_to_segments(points, *np.swapaxes(p_WEnds[at, index], 0, 1))
            clear[at] = distances.min(axis=1) > gaps[index]
    return clear


@cache
def _capsules_up_to(last_link: int) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the arm's capsules up to a link: their links (C,), ends (C, 2, 3) and radii (C,)."""
    chosen = [(link, capsule) for link, capsule in arm_capsules() if link <= last_link]
    links = np.array([link for link, _ in chosen])
    ends = np.stack([capsule.p_FEnds for _, capsule in chosen])
    return links, ends, np.array([capsule.radius_m for _, capsule in chosen])


def apart(p_WPs: Array, p_WStanding: Array) -> BoolArray:
    """Return (B,): whether held points (B, N, 3) are clear of standing ones (M, 3), M > 0."""
    gap_m = 2.0 * POINT_RADIUS_M
    lower, upper = p_WStanding.min(axis=0) - gap_m, p_WStanding.max(axis=0) + gap_m
    near = ((p_WPs >= lower) & (p_WPs <= upper)).all(axis=-1)
    clear = np.ones(len(p_WPs), dtype=bool)
    if near.any():
        tree = cKDTree(p_WStanding)
        distances, _ = tree.query(p_WPs[near], distance_upper_bound=gap_m)
        clear[np.nonzero(near)[0][np.isfinite(distances)]] = False
    return clear
