"""Which points of a cluttered cloud move with the hand, as far as a cloud without segments tells.

What hangs together with the points between the pads is taken for the object.  Things that touch
each other hang together too, so only what is near the hand counts.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PAD_SIZE_M

# Points this close hang together; the cloud is thinned to voxels of 4 mm.
LINK_M = 0.008
# Half of the longest object that a hand of 8 cm is meant for.
NEAR_HAND_M = 0.08


def taken_points(X_WG: Array, p_WPs: Array) -> NDArray[np.bool_]:
    """Return (N,): which of the points (N, 3) a hand takes that closes at X_WG (4, 4).

    None, where no point is between the pads.
    """
    p_GPs = transform_points(invert_pose(X_WG), p_WPs)
    near = np.linalg.norm(p_GPs, axis=1) < NEAR_HAND_M
    half = np.array([PAD_SIZE_M[0], MAX_OPENING_M, PAD_SIZE_M[1]]) / 2.0
    between = np.all(np.abs(p_GPs) < half, axis=1)
    taken = np.zeros(len(p_WPs), dtype=bool)
    if not between.any():
        return taken
    links = cKDTree(p_WPs[near]).sparse_distance_matrix(
        cKDTree(p_WPs[near]), LINK_M, output_type="coo_matrix"
    )
    _, label = connected_components(links, directed=False)
    taken[near] = np.isin(label, label[between[near]])
    return taken
