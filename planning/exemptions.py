"""Which points the declared contact HELD_PEG exempts; planner and independent check share this."""

import numpy as np
from numpy.typing import NDArray

from split_drake.poses import Array, invert_pose, transform_points

# The tube through the opening, around y_H: its radius, half its length, and how far it reaches
# towards the side from which the peg comes while the held object is lowered onto it.
TUBE_RADIUS_M = 0.014
TUBE_HALF_LENGTH_M = 0.03
MAX_LOWERING_M = 0.015


def peg_tube(p_WPs: Array, X_WH: Array, X_WHgoal: Array) -> NDArray[np.bool_]:
    """Return (N,): the points (N, 3) of an object that may touch the peg while it is hung.

    They lie within the tube around the handle's axis y_H, widened upwards (as seen at the goal) by
    the distance that the object is lowered.

    Args:
        p_WPs: points of the object before the pick.
        X_WH: (4, 4) handle before the pick.
        X_WHgoal: (4, 4) handle at the goal.
    """
    p_HPs = transform_points(invert_pose(X_WH), p_WPs)
    lowering_H = X_WHgoal[:3, :3].T @ (0.0, 0.0, MAX_LOWERING_M)
    section, travel = p_HPs[:, [0, 2]], lowering_H[[0, 2]]
    shares = np.clip(section @ travel / (travel @ travel), 0.0, 1.0)
    distances = np.linalg.norm(section - shares[:, None] * travel, axis=1)
    return (distances < TUBE_RADIUS_M) & (np.abs(p_HPs[:, 1]) < TUBE_HALF_LENGTH_M)
