"""How far declared contacts reach; planner and independent check share these definitions."""

import numpy as np
from numpy.typing import NDArray

from planning.collision.distances import distance_to_box
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import PALM

# The tube through the opening, around y_H: its radius, half its length, and how far it reaches
# towards the side from which the peg comes while the held object is lowered onto it.
TUBE_RADIUS_M = 0.014
TUBE_HALF_LENGTH_M = 0.03
MAX_LOWERING_M = 0.015

# HELD_TABLE lets points be this far below the table's top: by the 6 mm that lowering goes beyond
# the goal, the 6 mm by which the goal lets perceived points be too low, and 4 mm of tolerance.
TABLE_LOWERING_M = 0.006
TABLE_ERROR_M = 0.006
MAX_TABLE_DEPTH_M = TABLE_LOWERING_M + TABLE_ERROR_M + 0.004
# While an object moves straight along the peg, its points may be this deep in it and no deeper:
# centroids of a cloud's voxels lie a little inside the curve of a handle.
MAX_PEG_DEPTH_M = 0.003
# While an object is lifted, HELD_TABLE acts until it has risen by this much.
TABLE_LIFT_M = 0.015
# Points of a held object that are this near to the palm may have come so close while it was taken:
# the 6 mm that a planner's point stands for, and 1 mm of tolerance.
AT_PALM_M = 0.007


def clear_of_palm(X_WG: Array, p_WPs: Array) -> NDArray[np.bool_]:
    """Return (N,): which points (N, 3) of a held object are off the palm of a hand at X_WG (4, 4).

    The others may touch the palm for as long as the object is next to the hand.
    """
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    return np.asarray(distance_to_box(p_GPs, PALM) > AT_PALM_M)


def peg_tube(
    p_WPs: Array, X_WH: Array, X_WHgoal: Array, lowering_m: float = 0.0
) -> NDArray[np.bool_]:
    """Return (N,): the points (N, 3) of an object that may touch the peg while it is hung.

    They lie within the tube around the handle's axis y_H, widened upwards (as seen at the goal) by
    the distance that the object is lowered: not at all while it moves straight along the peg.

    Args:
        p_WPs: points of the object before the pick.
        X_WH: (4, 4) handle before the pick.
        X_WHgoal: (4, 4) handle at the goal.
        lowering_m: distance by which the object is lowered from the goal.
    """
    p_HPs = transform_points(invert_pose(X_WH), p_WPs)
    p_Lowering_H = X_WHgoal[:3, :3].T @ (0.0, 0.0, lowering_m)
    section, travel = p_HPs[:, [0, 2]], p_Lowering_H[[0, 2]]
    shares = np.clip(section @ travel / max(float(travel @ travel), 1e-12), 0.0, 1.0)
    distances = np.linalg.norm(section - shares[:, None] * travel, axis=1)
    return (distances < TUBE_RADIUS_M) & (np.abs(p_HPs[:, 1]) < TUBE_HALF_LENGTH_M)
