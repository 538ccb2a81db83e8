"""The frame that VGN and GIGA give grasps in, and ours.

Theirs, T, has its origin on the palm, the fingertips 5 cm ahead along z; y is the closing direction
in both.  Ours, G, lies between the centres of the pads.
"""

from split_drake.poses import Array, invert_pose, make_pose
from split_drake.robot.gripper import PAD_SIZE_M

FINGER_DEPTH_M = 0.05
# The pads' centres lie half their length behind the tips.
X_TG: Array = make_pose(p=(0.0, 0.0, FINGER_DEPTH_M - PAD_SIZE_M[1] / 2.0))
X_TG.setflags(write=False)


def grippers_of_palms(X_WTs: Array) -> Array:
    """Return X_WGs (..., 4, 4) of the palm poses X_WTs (..., 4, 4)."""
    return X_WTs @ X_TG


def palms_of_grippers(X_WGs: Array) -> Array:
    """Return X_WTs (..., 4, 4) of the grippers' poses X_WGs (..., 4, 4)."""
    return X_WGs @ invert_pose(X_TG)
