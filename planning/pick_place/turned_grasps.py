"""More grasps from those detected: a mug's body is round, so they may be turned about its axis."""

from itertools import product

import numpy as np

from planning.geometry.modes import distinct_modes
from planning.geometry.waypoints import with_half_turns
from planning.motion.ik import solve_ik
from planning.pick_place.fingers import fit_fingers, settled
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array, invert_pose, make_pose, rotation_y, rotation_z
from split_drake.robot.open_hand import lowest_heights

# Detected modes that are turned, the turns about the body's axis, and the tilts about the closing
# direction, which leave what is between the pads as it is.
MAX_MODES = 24
TURNS_RAD = np.radians(np.arange(0.0, 360.0, 20.0))
TILTS_RAD = np.radians((0.0, -30.0, 30.0, -60.0, 60.0))
# Turned and tilted grasps were not detected: they count less.
TURNED, TILTED = 0.9, 0.8


def turned_grasps(grasps: PoseSet, X_WU: Array, p_WSurface: Array, table_z_m: float) -> PoseSet:
    """Return the grasps turned about z_U of the upright pose (4, 4) that may be of use.

    The arm reaches them, the open hand is above the table's top at `table_z_m` in W, and some
    opening clears the surface's points (M, 3) and has one between the pads: where a handle was
    grasped, or is in the way, only the cloud tells.
    """
    modes = distinct_modes(grasps.X_WPs, MAX_MODES, GRASP.symmetry)
    X_UGs = invert_pose(X_WU) @ grasps.X_WPs[modes]
    poses, scores = [], []
    for turn, tilt in product(TURNS_RAD, TILTS_RAD):
        poses.append(X_WU @ make_pose(rotation_z(turn)) @ X_UGs @ make_pose(rotation_y(tilt)))
        scores.append(grasps.scores[modes] * (TURNED if turn else 1.0) * (TILTED if tilt else 1.0))
    turned = PoseSet.ranked(grasps.task, np.concatenate(poses), np.concatenate(scores))
    above = turned.subset(lowest_heights(turned.X_WPs) > table_z_m)
    solved = solve_ik(with_half_turns(above.X_WPs)).pose_index
    reached = np.zeros(len(above), dtype=bool)
    reached[solved % max(1, len(above))] = True
    near = above.subset(reached)
    fits = [fit_fingers(settled(X_WG, p_WSurface), p_WSurface) for X_WG in near.X_WPs]
    return near.subset(np.array([fit.clears and fit.pinches for fit in fits], dtype=bool))
