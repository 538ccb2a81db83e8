"""What is believed of grasps beside one that has just failed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from split_drake.pose_set import PoseSet
from split_drake.poses import Array


@dataclass(frozen=True)
class Doubt:
    """How high a grasp has to be scored where one has failed, and none has succeeded since.

    What lies there is as it was.  Why it could not be taken, such as that it is thinner than it
    looks, one view often does not show: other grasps of the same thing are scored too high as well.

    Attributes:
        within_m: grasps this near to the failed one are doubted, by their points between the pads.
        least: score from which they are believed all the same.
    """

    within_m: float
    least: float

    def believed(self, found: PoseSet, X_WGfailed: Sequence[Array]) -> PoseSet:
        """Return those grasps that are worth a try after the failed ones, each (4, 4)."""
        p_WFs = np.reshape([X_WG[:3, 3] for X_WG in X_WGfailed], (-1, 1, 3))
        distances_m = np.linalg.norm(found.X_WPs[:, :3, 3] - p_WFs, axis=2)
        beside = distances_m.min(axis=0, initial=np.inf) < self.within_m
        return found.subset(~beside | (found.scores >= self.least))
