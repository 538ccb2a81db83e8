"""How wide to open the fingers for a grasp, and how well it pinches, from the cloud alone."""

from dataclasses import dataclass

import numpy as np

from planning.distances import distance_to_box
from split_drake.gripper import MAX_OPENING_M, PAD_SIZE_M, Box, finger_boxes
from split_drake.poses import Array, invert_pose, transform_points

APPROACH_M = 0.08
# Room between fingers and object beyond which more is no better.
ENOUGH_CLEARANCE_M = 0.010
# Fingers open this close to the object when they let go: an object that swings needs the room.
RELEASE_CLEARANCE_M = 0.004
OPENING_STEPS = 18


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


def fit_fingers(X_WG: Array, p_WPs: Array) -> FingerFit:
    """Return how the opened hand fits around the points (N, 3) at the grasp `X_WG`."""
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    near = (np.abs(p_GPs[:, 0]) < 0.03) & (np.abs(p_GPs[:, 1]) < 0.08) & (p_GPs[:, 2] < 0.03)
    p_GPs = p_GPs[near]
    openings = np.linspace(0.010, MAX_OPENING_M, OPENING_STEPS)
    clearances = np.array([_clearance(p_GPs, opening) for opening in openings])
    best = int(np.argmax(np.minimum(clearances, ENOUGH_CLEARANCE_M)))
    opening = float(openings[best])
    clearance = float(min(clearances[best], ENOUGH_CLEARANCE_M))
    roomy = openings[clearances >= min(clearance, RELEASE_CLEARANCE_M)]
    return FingerFit(opening, clearance, float(roomy.max()), _pinch_depth(p_GPs, opening))


def _clearance(p_GPs: Array, opening_m: float) -> float:
    """Return the least distance of the points to the fingers on their way to the grasp."""
    distances = [distance_to_box(p_GPs, _swept(box)) for box in finger_boxes(opening_m)]
    return float(np.min(distances, initial=np.inf))


def _swept(box: Box) -> Box:
    x, y, z = box.lower
    return Box((x, y, z - APPROACH_M), box.upper)


def _pinch_depth(p_GPs: Array, opening_m: float) -> float:
    half_x, half_z = PAD_SIZE_M[0] / 2.0, PAD_SIZE_M[1] / 2.0
    between = (
        (np.abs(p_GPs[:, 0]) < half_x)
        & (np.abs(p_GPs[:, 1]) < opening_m / 2.0)
        & (np.abs(p_GPs[:, 2]) < half_z)
    )
    if not between.any():
        return 0.0
    return float(half_z - p_GPs[between, 2].min())
