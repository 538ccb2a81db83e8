"""The wide-open hand, as the protocol of clutter removal has it come in."""

import numpy as np
import trimesh

from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M, gripper_boxes

OPEN_HAND = gripper_boxes(MAX_OPENING_M)
_CORNERS_G = np.concatenate([trimesh.bounds.corners([b.lower, b.upper]) for b in OPEN_HAND])


def lowest_heights(X_WGs: Array) -> Array:
    """Return (N,) the height in W, metres, of the lowest corner of open hands at (N, 4, 4)."""
    heights_m: Array = X_WGs[:, 2, :3] @ _CORNERS_G.T + X_WGs[:, 2, 3:]
    return heights_m.min(axis=1)
