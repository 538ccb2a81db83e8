"""What is believed of grasps of a thing that one has just failed to take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from split_drake.objects_in_view import objects_in_view, owners
from split_drake.pose_set import PoseSet
from split_drake.poses import Array


@dataclass(frozen=True)
class Doubt:
    """How high a grasp has to be scored where one has failed, and none has succeeded since.

    What lies there is as it was.  Why it could not be taken, such as that it is thinner than it
    looks, one view often does not show: other grasps of the same thing are scored too high as well.

    Attributes:
        within_m: grasps this near to the failed one are doubted, by their points between the pads.
        thing_m: so are all grasps of what the failed one belonged to, if that is seen apart from
            all else and is no larger than this: what is larger is a heap.
        least: score from which they are believed all the same.
    """

    within_m: float
    thing_m: float
    least: float

    def believed(self, found: PoseSet, X_WGfailed: Sequence[Array], p_WPs: Array) -> PoseSet:
        """Return those grasps that are worth a try after the failed ones, each (4, 4).

        Args:
            p_WPs: (N, 3) what is seen now.
        """
        if not len(found) or not X_WGfailed:
            return found
        failed = np.stack(X_WGfailed)
        doubted = self._near(found.X_WPs, failed) | self._of_same_thing(found.X_WPs, failed, p_WPs)
        return found.subset(~doubted | (found.scores >= self.least))

    def _near(self, X_WGs: Array, X_WGfailed: Array) -> NDArray[np.bool_]:
        offsets = X_WGs[:, None, :3, 3] - X_WGfailed[:, :3, 3]
        return np.asarray(np.linalg.norm(offsets, axis=2).min(axis=1) < self.within_m)

    def _of_same_thing(self, X_WGs: Array, X_WGfailed: Array, p_WPs: Array) -> NDArray[np.bool_]:
        objects = objects_in_view(p_WPs)
        if not objects:
            return np.zeros(len(X_WGs), dtype=bool)
        small = np.array([np.ptp(each.p_WPs, axis=0).max() <= self.thing_m for each in objects])
        things = np.unique(owners(X_WGfailed, objects))
        return np.isin(owners(X_WGs, objects), things[small[things]])
