"""More grasps from those detected: a mug's body is round, so they may be turned about its axis."""

from itertools import product

import numpy as np

from planning.geometry.modes import distinct_modes
from planning.geometry.waypoints import with_half_turns
from planning.motion.ik import solve_ik
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array, invert_pose, make_pose, rotation_y, rotation_z

# Detected modes that are turned, the turns about the body's axis, and the tilts about the closing
# direction, which leave what is between the pads as it is.
MAX_MODES = 24
TURNS_RAD = np.radians(np.arange(0.0, 360.0, 20.0))
TILTS_RAD = np.radians((0.0, -30.0, 30.0))
# Turned and tilted grasps were not detected: they count less.
TURNED, TILTED = 0.9, 0.8


def turned_grasps(grasps: PoseSet, X_WU: Array) -> PoseSet:
    """Return the grasps turned about z_U of the upright pose (4, 4), those that the arm reaches.

    Where a handle was grasped, or is in the way, only the cloud tells: fit them to the surface.
    """
    modes = distinct_modes(grasps.X_WPs, MAX_MODES, GRASP.symmetry)
    X_UGs = invert_pose(X_WU) @ grasps.X_WPs[modes]
    poses, scores = [], []
    for turn, tilt in product(TURNS_RAD, TILTS_RAD):
        poses.append(X_WU @ make_pose(rotation_z(turn)) @ X_UGs @ make_pose(rotation_y(tilt)))
        scores.append(grasps.scores[modes] * (TURNED if turn else 1.0) * (TILTED if tilt else 1.0))
    X_WGs, values = np.concatenate(poses), np.concatenate(scores)
    reached = np.unique(solve_ik(with_half_turns(X_WGs)).pose_index % len(X_WGs))
    return PoseSet.ranked(grasps.task, X_WGs[reached], values[reached])
