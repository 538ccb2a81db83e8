"""How wide to open the fingers for a grasp, and how well it pinches, from the cloud alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from split_drake.gripper import MAX_OPENING_M, PAD_SIZE_M, finger_boxes
from split_drake.poses import Array, invert_pose, make_pose, transform_points

APPROACH_M = 0.08
# Room between fingers and object beyond which more is no better.
ENOUGH_CLEARANCE_M = 0.010
# Fingers open this close to the object when they let go: an object that swings needs the room.
RELEASE_CLEARANCE_M = 0.004
OPENING_STEPS = 18
MAX_CENTERING_M = 0.005


@dataclass(frozen=True)
class FingerFit:
    """The hand around the object at one grasp.

    Attributes:
        opening_m: the opening with the most room on the whole approach.
        clearance_m: that room, at most `ENOUGH_CLEARANCE_M`.
        release_m: the widest opening that keeps some room.
        pinch_depth_m: how far the object reaches between the pads from their tips, 0 to the
            pads' length.
    """

    opening_m: float
    clearance_m: float
    release_m: float
    pinch_depth_m: float


def centered(X_WG: Array, p_WPs: Array) -> Array:
    """Return the grasp moved along y_G so that what is between the pads lies in their middle.

    Fingers that close off centre push the object until both touch it.  Where more than
    `MAX_CENTERING_M` is missing, one side was probably not seen, and the grasp stays as it is.
    """
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    between = p_GPs[_between_pads(p_GPs, fit_fingers(X_WG, p_WPs).opening_m), 1]
    if not len(between):
        return X_WG
    offset = 0.5 * (between.min() + between.max())
    if abs(offset) > MAX_CENTERING_M:
        return X_WG
    return X_WG @ make_pose(p=(0.0, offset, 0.0))


def fit_fingers(X_WG: Array, p_WPs: Array) -> FingerFit:
    """Return how the opened hand fits around the points (N, 3) at the grasp `X_WG`."""
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    near = (np.abs(p_GPs[:, 0]) < 0.03) & (np.abs(p_GPs[:, 1]) < 0.08) & (p_GPs[:, 2] < 0.03)
    p_GPs = p_GPs[near]
    openings = np.linspace(0.010, MAX_OPENING_M, OPENING_STEPS)
    clearances = _clearances(p_GPs, openings)
    best = int(np.argmax(np.minimum(clearances, ENOUGH_CLEARANCE_M)))
    opening = float(openings[best])
    clearance = float(min(clearances[best], ENOUGH_CLEARANCE_M))
    roomy = openings[clearances >= min(clearance, RELEASE_CLEARANCE_M)]
    return FingerFit(opening, clearance, float(roomy.max()), _pinch_depth(p_GPs, opening))


def _clearances(p_GPs: Array, openings_m: Array) -> Array:
    """Return (M,) the least distance of the points to the fingers on their way to the grasp.

    The fingers move along z, and with the opening only along y; both are alike, so |y| counts.
    """
    x, y, z = np.abs(p_GPs[:, 0]), np.abs(p_GPs[:, 1]), p_GPs[:, 2]
    squared = np.full(len(openings_m), np.inf)
    for finger in finger_boxes(0.0)[::2]:
        lower, upper = np.array(finger.lower), np.array(finger.upper)
        beside = np.maximum(x - upper[0], 0.0)
        beyond = np.maximum(np.maximum(z - upper[2], lower[2] - APPROACH_M - z), 0.0)
        near, far = (bound + openings_m[:, None] / 2.0 for bound in (lower[1], upper[1]))
        across = np.maximum(np.maximum(near - y, y - far), 0.0)
        distances = np.square(beside) + np.square(beyond) + np.square(across)
        squared = np.minimum(squared, distances.min(axis=1, initial=np.inf))
    return np.sqrt(squared)


def _pinch_depth(p_GPs: Array, opening_m: float) -> float:
    between = p_GPs[_between_pads(p_GPs, opening_m), 2]
    return float(np.max(PAD_SIZE_M[1] / 2.0 - between, initial=0.0))


def _between_pads(p_GPs: Array, opening_m: float) -> NDArray[np.bool_]:
    half = np.array([PAD_SIZE_M[0], opening_m, PAD_SIZE_M[1]]) / 2.0
    return np.all(np.abs(p_GPs) < half, axis=1)
