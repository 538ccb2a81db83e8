"""What the cameras show of an object in the hand, and how it moved while it was taken."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planning.collision.distances import arm_capsules, distance_to_box, distance_to_segments
from planning.geometry.perceived import voxel_centroids
from planning.geometry.registration import nearest_start, register
from split_drake.camera import DepthView
from split_drake.poses import (
    Array,
    invert_pose,
    make_pose,
    rotation_error_rad,
    rotation_y,
    transform_points,
)
from split_drake.robot.gripper import MAX_OPENING_M, gripper_boxes
from split_drake.robot.kinematics import gripper_pose, link_poses

# Points this close to the shapes that stand for the hand, and for the arm, may be the robot: the
# arm's capsules leave out more of what is seen of it.
HAND_MARGIN_M, ARM_MARGIN_M = 0.008, 0.030
# So may points this close to other things be these.
OTHERS_MARGIN_M = 0.012
# A held object is sought within this distance of where it is expected.
SEARCH_M = 0.03
MODEL_VOXEL_M, SEEN_VOXEL_M = 0.0025, 0.004
# A measurement counts where this many voxels were seen, this share of them lies on the object, at
# this distance, and where it moved no further than objects move without falling.
MIN_SEEN = 100
MIN_MATCHED = 0.8
MAX_ERROR_M = 0.0015
MAX_SHIFT_M = 0.03
MAX_TURN_RAD = np.radians(75.0)
# Friction hardly resists a turn about the closing direction: turns up to this are looked for.
PIVOTS_RAD = np.radians(sorted(range(-60, 61, 12), key=abs))


@dataclass(frozen=True)
class HeldView:
    """A measurement of how an object lies in the hand.

    E is the frame that the gripper had, relative to the object, where it was to be taken: the
    object's points in E are those in G as long as nothing moved.

    Attributes:
        X_GE: (4, 4) the measured motion; the last one known where the measurement was rejected.
        matched: share of what was seen around the hand that lies on the object.
        rejected: why the measurement does not count; empty where it does.
        elsewhere: whether that is because too little of what was seen around the hand lies on the
            object, however it was turned, or because it has moved implausibly far.
    """

    X_GE: Array
    matched: float = 0.0
    rejected: str = ""
    elsewhere: bool = False

    @property
    def shift_m(self) -> float:
        """Distance by which the object's middle, between the pads, has moved."""
        return float(np.linalg.norm(self.X_GE[:3, 3]))

    @property
    def turn_rad(self) -> float:
        """Angle by which the object has turned in the hand."""
        return float(rotation_error_rad(self.X_GE[:3, :3], np.eye(3)))


def view_held(
    views: Sequence[DepthView],
    q: Array,
    opening_m: float,
    p_EPs: Array,
    lowest_z_m: float,
    X_GEexpected: Array | None = None,
    p_WOthers: Array | None = None,
) -> HeldView:
    """Measure how the object lies in the hand by registering its cloud to what the views show.

    Args:
        views: taken with the arm at `q`, the object away from the table.
        q: (7,) measured joint angles, rad.
        opening_m: measured distance between the pads.
        p_EPs: (N, 3) cloud of the object before it was taken, in the gripper's frame at the grasp.
        lowest_z_m: height in W up to which points count as table.
        X_GEexpected: (4, 4) the last known motion in the hand; none where not given.
        p_WOthers: (O, 3) points of other things, which stand where they did.
    """
    expected = np.eye(4) if X_GEexpected is None else X_GEexpected
    p_EMs = voxel_centroids(p_EPs, MODEL_VOXEL_M)
    p_WPs = apart_from(beside_robot(views, q, opening_m, lowest_z_m), p_WOthers)
    seen = transform_points(invert_pose(gripper_pose(q)), p_WPs)
    reach = np.linalg.norm(p_EMs, axis=1).max() + SEARCH_M
    p_GPs = voxel_centroids(seen[np.linalg.norm(seen, axis=1) < reach], SEEN_VOXEL_M)
    if len(p_GPs) < MIN_SEEN:
        return HeldView(expected, rejected=f"{len(p_GPs)} voxels were seen, expected {MIN_SEEN}")
    pivots = np.stack([make_pose(rotation_y(angle)) @ expected for angle in PIVOTS_RAD])
    start = nearest_start(p_EMs, p_GPs, pivots)
    found = register(transform_points(start, p_EMs), p_GPs)
    if found.matched < MIN_MATCHED or found.error_m > MAX_ERROR_M:
        quality = f"{found.matched:.0%} of it matches, {1e3 * found.error_m:.1f} mm off"
        reason = f"{quality}; expected {MIN_MATCHED:.0%}, {1e3 * MAX_ERROR_M} mm"
        return HeldView(expected, found.matched, reason, found.matched < MIN_MATCHED)
    held = HeldView(found.X_AM @ start, found.matched)
    if held.shift_m > MAX_SHIFT_M or held.turn_rad > MAX_TURN_RAD:
        motion = f"{1e3 * held.shift_m:.0f} mm and {np.degrees(held.turn_rad):.0f} degrees"
        reason = f"it seems to have moved by {motion}"
        return HeldView(expected, found.matched, reason, elsewhere=True)
    return held


def apart_from(p_WPs: Array, p_WOthers: Array | None) -> Array:
    """Return those of the points (N, 3) that are not of other things (O, 3), if any are known."""
    if p_WOthers is None or not len(p_WOthers):
        return p_WPs
    distances, _ = cKDTree(p_WOthers).query(p_WPs, distance_upper_bound=OTHERS_MARGIN_M)
    return p_WPs[~np.isfinite(distances)]


def beside_robot(
    views: Sequence[DepthView], q: Array, opening_m: float, lowest_z_m: float
) -> Array:
    """Return the points (N, 3) in W that views show above a height and off the robot at `q` (7,).

    Args:
        views: taken with the arm at `q`.
        q: (7,) measured joint angles, rad.
        opening_m: measured distance between the pads.
        lowest_z_m: height in W up to which points are left out.
    """
    p_WPs = np.concatenate([np.empty((0, 3)), *(view.points(lowest_z_m) for view in views)])
    return p_WPs[~_on_robot(p_WPs, q, opening_m)]


def _on_robot(p_WPs: Array, q: Array, opening_m: float) -> NDArray[np.bool_]:
    """Return (N,): which points (N, 3) may belong to the robot."""
    p_GPs = transform_points(invert_pose(gripper_pose(q)), p_WPs)
    on_robot = np.zeros(len(p_WPs), dtype=bool)
    for box in gripper_boxes(float(np.clip(opening_m, 0.0, MAX_OPENING_M))):
        on_robot |= distance_to_box(p_GPs, box) < HAND_MARGIN_M
    X_WLs = np.concatenate([make_pose()[None], link_poses(q[None])[0]])
    for link, capsule in arm_capsules():
        p_WEnds = transform_points(X_WLs[link], capsule.p_FEnds)
        on_robot |= distance_to_segments(p_WPs, *p_WEnds) < capsule.radius_m + ARM_MARGIN_M
    return on_robot
