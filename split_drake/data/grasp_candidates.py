"""Grasp candidates of a mug, and which of them are true in a scene (paper section V)."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from split_drake.data.mug_scenes import MugScene
from split_drake.grasps.judge import GraspJudge, hand_corners, reachable
from split_drake.grasps.sampling import false_grasps
from split_drake.grasps.store import CheckedGrasps
from split_drake.grasps.visibility import GraspVisibility
from split_drake.objects.mug_shape import MugShape
from split_drake.poses import Array, make_pose

FALSE_GRASPS = 200
# True grasps keep at least this weight, so that none is forgotten.
MIN_WEIGHT = 0.02


class GraspState(IntEnum):
    """What a candidate is in a scene."""

    PADDING = 0
    TRUE = 1
    FALSE = 2


@dataclass(frozen=True)
class GraspCandidates:
    """Grasps of a mug that are true or false, depending on the scene or wherever it lies.

    Attributes:
        mug: the shape.
        X_OGs: (L, 4, 4) grasps.
        openings_m: (L,) that the hand comes in with.
        weights: (L,) how often to learn a grasp where it is true, in (0, 1]; 0 for grasps that
            hold in no scene.
    """

    mug: MugShape
    X_OGs: Array
    openings_m: Array
    weights: Array

    @classmethod
    def from_checked(cls, mug: MugShape, checked: CheckedGrasps, rng: np.random.Generator) -> Self:
        """Return the grasps tried in physics, with their mirror images, and geometric false ones.

        The weight of a grasp that holds is its robustness in physics times its squared steadiness:
        grasps that a small error spoils are taught less often.
        """
        tried = checked.with_mirror_images()
        steady = GraspJudge(mug.body.mesh).steadiness(tried.X_OGs, tried.openings_m, rng)
        weights = np.maximum(tried.robustness * steady**2, MIN_WEIGHT) * tried.holds
        false = false_grasps(mug, tried.X_OGs[tried.holds], FALSE_GRASPS, rng)
        return cls(
            mug,
            np.concatenate([tried.X_OGs, false.X_OGs]),
            np.concatenate([tried.openings_m, false.openings_m]),
            np.concatenate([weights, np.zeros(len(false.X_OGs))]),
        )

    def states(self, scene: MugScene) -> NDArray[np.uint8]:
        """Return (L,) the `GraspState` of each candidate.

        True are those that hold in physics, clear the table, come from above, and are visible.
        """
        X_TableO = make_pose(p=(0.0, 0.0, -scene.table_z_m)) @ scene.X_WO
        true = (
            (self.weights > 0.0)
            & reachable(X_TableO, self.X_OGs, self._p_OCorners)
            & self._visibility.visible(scene.X_WO, scene.p_WPs)
        )
        return np.where(true, np.uint8(GraspState.TRUE), np.uint8(GraspState.FALSE))

    @cached_property
    def _p_OCorners(self) -> Array:
        return hand_corners(self.X_OGs, self.openings_m)

    @cached_property
    def _visibility(self) -> GraspVisibility:
        return GraspVisibility(self.mug.body.mesh, self.X_OGs, self.openings_m)
