"""Grasps that a planner may try, each fitted to the cloud when its turn comes."""

from functools import cache

import numpy as np

from planning.geometry.modes import distinct_modes
from planning.geometry.perceived import PerceivedObject
from planning.geometry.waypoints import with_half_turns
from planning.pick_place.fingers import FingerFit, fit_fingers, settled
from planning.pick_place.pick import balance, firmness
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array

MAX_GRASPS = 256
# Where a pose set has fewer modes than that, more of their poses are tried, at this share of their
# score.
REPEATED_MODE = 0.5


class Candidates:
    """Grasps to try: N of a pose set, then the same turned by half about the hand's axis.

    Attributes:
        bounds: (2N,) what their scores are at most.

    Args:
        grasps: as detected.
        target: the object, as perceived.
        p_WSurface: (M, 3) points of the surface that hand and fingers are fitted to.
    """

    def __init__(self, grasps: PoseSet, target: PerceivedObject, p_WSurface: Array) -> None:
        preferred = PoseSet.ranked(
            grasps.task, grasps.X_WPs, grasps.scores * balance(grasps.X_WPs, target)
        )
        modes = distinct_modes(preferred.X_WPs, MAX_GRASPS, GRASP.symmetry)
        chosen = modes + [i for i in range(len(preferred)) if i not in modes]
        chosen = chosen[:MAX_GRASPS]
        novelty = np.where(np.isin(chosen, modes), 1.0, REPEATED_MODE)
        self._X_WGs = preferred.X_WPs[chosen]
        self._scores = preferred.scores[chosen] * novelty
        self.bounds = np.tile(self._scores, 2)
        self._p_WSurface = p_WSurface
        self._fitted = cache(self._fit)

    def score(self, row: int) -> float:
        """Return the score of a grasp, by how it fits."""
        index = row % len(self._X_WGs)
        return float(self._scores[index] * firmness([self._fitted(index)[1]])[0])

    def at(self, row: int) -> tuple[Array, FingerFit]:
        """Return a grasp (4, 4), settled to the surface, and how the hand fits there."""
        half_turns, index = divmod(row, len(self._X_WGs))
        X_WG, fit = self._fitted(index)
        return with_half_turns(X_WG[None])[half_turns], fit

    def _fit(self, index: int) -> tuple[Array, FingerFit]:
        X_WG = settled(self._X_WGs[index], self._p_WSurface)
        return X_WG, fit_fingers(X_WG, self._p_WSurface)
