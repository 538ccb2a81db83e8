from enum import StrEnum

import numpy as np

from split_drake.poses import make_pose, rotation_z

# The object's frame is the same after a half turn of the gripper about its approach direction.
HALF_TURN = make_pose(rotation_z(np.pi))
# H and H Rot_x(pi) are the same handle.
HANDLE_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


class PoseTask(StrEnum):
    """What a pose is for.

    GRASP: X_WG of a gripper that closes on the object.  After a half turn about z_G it is the same.
    HANDLE: X_WH of the handle's opening, y_H through it.  After a half turn about x_H it is the
        same: nothing says whether z_H points to the rim or to the base.
    UPRIGHT: X_WU of the object, z_U to its rim; where the object is to stand, that becomes z_W.
    """

    GRASP = "grasp"
    HANDLE = "handle"
    UPRIGHT = "upright"
