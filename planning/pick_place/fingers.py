"""How wide to open the fingers for a grasp, and how well it pinches, from the cloud alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from planning.geometry.waypoints import APPROACH_M
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PAD_SIZE_M, finger_boxes

# Room between fingers and object beyond which more is no better.
ENOUGH_CLEARANCE_M = 0.010
# Fingers open this close to the object when they let go: an object that swings needs the room.
RELEASE_CLEARANCE_M = 0.004
# Less room than this is none: the cloud is some millimetres off.
MIN_CLEARANCE_M = 0.002
OPENING_STEPS = 18
# Limits of the corrections that square a grasp up and centre it.
MAX_CENTERING_M = 0.005
MAX_SQUARING_RAD = np.radians(15.0)
# A wall: no thicker than this, with this many points, spread this much less across than along.
MAX_WALL_M = 0.012
MIN_PATCH_POINTS = 12
FLAT_RATIO = 0.5


@dataclass(frozen=True)
class FingerFit:
    """The hand around the object at one grasp.

    Attributes:
        opening_m: the opening with the most room on the whole approach.
        clearance_m: that room, at most `ENOUGH_CLEARANCE_M`.
        release_m: the widest opening that keeps some room.
        held_width_m: of what is between the pads, taken to be as wide to either side of the grasp:
            of one side nothing may have been seen.
        pinch_depth_m: how far the object reaches between the pads from their tips, 0 to the
            pads' length.
        stem_room_m: room between the object and the fingers' stems once the pads bear on it;
            below 0 the stems of a bulging object's fingers meet it before the pads do.
    """

    opening_m: float
    clearance_m: float
    release_m: float
    held_width_m: float
    pinch_depth_m: float
    stem_room_m: float

    @property
    def clears(self) -> bool:
        """Whether some opening leaves room enough."""
        return self.clearance_m >= MIN_CLEARANCE_M

    @property
    def pinches(self) -> bool:
        """Whether a part of the object is between the pads."""
        return self.pinch_depth_m > 0.0


def settled(X_WG: Array, p_WPs: Array) -> Array:
    """Return the grasp as closing fingers would have it: square to a wall, and in its middle.

    Fingers that close at an angle or off centre turn and push the object until both pads bear on
    it.  What lies between the pads is squared up only where it is thin and flat, and only by small
    corrections: with larger ones, a side was probably not seen.
    """
    between = _between(X_WG, p_WPs)
    if len(between) >= MIN_PATCH_POINTS and np.ptp(between[:, 1]) < MAX_WALL_M:
        X_WG = X_WG @ make_pose(_squaring(between))
        between = _between(X_WG, p_WPs)
    if not len(between):
        return X_WG
    offset = 0.5 * (between[:, 1].min() + between[:, 1].max())
    if abs(offset) > MAX_CENTERING_M:
        return X_WG
    return X_WG @ make_pose(p=(0.0, offset, 0.0))


def _between(X_WG: Array, p_WPs: Array) -> Array:
    """Return p_GPs (M, 3) of the points that the fitted fingers have between their pads."""
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    return p_GPs[_between_pads(p_GPs, fit_fingers(X_WG, p_WPs).opening_m)]


def _squaring(p_GPs: Array) -> Array:
    """Return the rotation (3, 3) that turns y onto the normal of a patch of points (N, 3)."""
    variances, axes = np.linalg.eigh(np.cov(p_GPs.T))
    normal = axes[:, 0] * (1.0 if axes[1, 0] > 0.0 else -1.0)
    angle = np.arccos(np.clip(normal[1], -1.0, 1.0))
    if variances[0] > FLAT_RATIO * variances[1] or not 1e-6 < angle < MAX_SQUARING_RAD:
        return np.eye(3)
    axis = np.cross([0.0, 1.0, 0.0], normal)
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()


def fit_fingers(X_WG: Array, p_WPs: Array) -> FingerFit:
    """Return how the opened hand fits around the points (N, 3) at the grasp `X_WG`."""
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    near = (np.abs(p_GPs[:, 0]) < 0.03) & (np.abs(p_GPs[:, 1]) < 0.08) & (p_GPs[:, 2] < 0.03)
    p_GPs = p_GPs[near]
    openings = np.linspace(0.010, MAX_OPENING_M, OPENING_STEPS)
    clearances = np.minimum(_clearances(p_GPs, openings), ENOUGH_CLEARANCE_M)
    fitting = _first_run(clearances > 0.0)
    best = fitting.start + int(np.argmax(clearances[fitting]))
    opening, clearance = float(openings[best]), float(clearances[best])
    wider = slice(best, fitting.stop)
    roomy = openings[wider][clearances[wider] >= min(clearance, RELEASE_CLEARANCE_M)]
    return FingerFit(
        opening_m=opening,
        clearance_m=clearance,
        release_m=float(roomy.max()),
        held_width_m=2.0 * _half_width(p_GPs, opening),
        pinch_depth_m=_pinch_depth(p_GPs, opening),
        stem_room_m=_stem_room(p_GPs, opening),
    )


def _first_run(true: NDArray[np.bool_]) -> slice:
    """Return the first run of true values, all of them where none is true.

    Beyond the first openings that fit come those that take in something else as well, such as the
    opposite wall; the fingers cannot get there without touching it.
    """
    if not true.any():
        return slice(0, len(true))
    start = int(np.argmax(true))
    ends = np.flatnonzero(~true[start:])
    return slice(start, start + int(ends[0]) if len(ends) else len(true))


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


def _half_width(p_GPs: Array, opening_m: float) -> float:
    """Return how far what is between the pads reaches from the middle towards either."""
    return float(np.abs(p_GPs[_between_pads(p_GPs, opening_m), 1]).max(initial=0.0))


def _stem_room(p_GPs: Array, opening_m: float) -> float:
    """Return how far the stems stay from points between them when the pads have closed."""
    stem = finger_boxes(0.0)[2]
    recess_m = stem.lower[1]
    beside_stems = (
        (np.abs(p_GPs[:, 0]) < stem.upper[0])
        & (np.abs(p_GPs[:, 1]) < opening_m / 2.0 + recess_m)
        & (p_GPs[:, 2] > stem.lower[2])
        & (p_GPs[:, 2] < stem.upper[2])
    )
    bulge = np.abs(p_GPs[beside_stems, 1]).max(initial=0.0)
    return float(_half_width(p_GPs, opening_m) + recess_m - bulge)


def _between_pads(p_GPs: Array, opening_m: float) -> NDArray[np.bool_]:
    half = np.array([PAD_SIZE_M[0], opening_m, PAD_SIZE_M[1]]) / 2.0
    return np.all(np.abs(p_GPs) < half, axis=1)
