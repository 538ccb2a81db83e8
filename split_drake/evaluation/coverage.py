"""How much of what is true was found: grasps near which a detected one lies."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from split_drake.poses import Array

NEAR_POSITION_M = 0.02
NEAR_ROTATION_RAD = np.radians(20.0)

# R Rot_z(pi) is the same grasp as R; its columns x and y change their signs.
_TURNS = (np.ones(9), np.array([-1.0, -1.0, 1.0] * 3))


def covered(X_WTruths: Array, X_WGs: Array) -> NDArray[np.bool_]:
    """Return (M,): whether one of the grasps (N, 4, 4) lies near each true one (M, 4, 4).

    Near means within 2 cm and 20 degrees, half a turn about z counted as nothing.
    """
    if not len(X_WTruths) or not len(X_WGs):
        return np.zeros(len(X_WTruths), dtype=bool)
    near = cdist(X_WTruths[:, :3, 3], X_WGs[:, :3, 3]) <= NEAR_POSITION_M
    R_truths, R_found = (X[:, :3, :3].reshape(-1, 9) for X in (X_WTruths, X_WGs))
    traces = [(R_truths * turn) @ R_found.T for turn in _TURNS]
    aligned = np.maximum(*traces) >= 1.0 + 2.0 * np.cos(NEAR_ROTATION_RAD)
    return np.any(near & aligned, axis=1)
