"""Which grasps get a second look."""

import numpy as np
from numpy.typing import NDArray

from split_drake.pose_task import GRASP
from split_drake.poses import Array

# Chosen among so many of the best.
CONSIDERED = 64
# A grasp that is as near to a chosen one as this is left out: many are nearly the same, and of one
# that fails the others fail as well.
NEAR_M, NEAR_RAD = 0.006, 0.3


def worth_a_look(X_WGs: Array, logits: Array, count: int) -> NDArray[np.intp]:
    """Return indices (min(count, N),) of the best grasps (N, 4, 4), by logits (N,), best first.

    Of grasps that are nearly the same only the best is taken, as long as there are others among the
    `CONSIDERED` best.
    """
    order = np.argsort(-logits, kind="stable")[: max(CONSIDERED, count)]
    X = X_WGs[order]
    distances_m = np.linalg.norm(X[:, None, :3, 3] - X[None, :, :3, 3], axis=-1)
    R = X[:, :3, :3]
    angles = GRASP.symmetry.rotation_error_rad(R[:, None], R[None])
    near = (distances_m < NEAR_M) & (angles < NEAR_RAD)
    chosen, others = list[int](), list[int]()
    for number in range(len(X)):
        (others if near[number, chosen].any() else chosen).append(number)
    kept = np.sort((chosen + others)[:count])
    return np.asarray(order[kept])
