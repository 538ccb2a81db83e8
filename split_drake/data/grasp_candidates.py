"""Grasp candidates of an object, and which of them are true in a scene (paper section V)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from split_drake.data.labels import PoseState
from split_drake.data.object_scenes import ObjectScene
from split_drake.grasps.judge import GraspJudge, hand_corners, reachable
from split_drake.grasps.sampling import false_grasps, sample_grasps
from split_drake.grasps.store import CheckedGrasps
from split_drake.grasps.visibility import GraspVisibility
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import TaskObject
from split_drake.poses import Array

FALSE_GRASPS = 200
# As many as are tried in physics of a mug, mirror images included.
GEOMETRIC_GRASPS = 300
# True grasps keep at least this weight, so that none is forgotten.
MIN_WEIGHT = 0.02
# Scenes with fewer true grasps are of little use.
MIN_TRUE_GRASPS = 8


@dataclass(frozen=True)
class GraspCandidates:
    """Grasps of an object that are true or false, depending on the scene; `PoseLabels`.

    Attributes:
        body: the object.
        X_OGs: (L, 4, 4) grasps.
        openings_m: (L,) that the hand comes in with.
        weights: (L,) how often to learn a grasp where it is true, in (0, 1]; 0 for grasps that
            hold in no scene.
    """

    body: RigidObject
    X_OGs: Array
    openings_m: Array
    weights: Array
    least_true: int = MIN_TRUE_GRASPS

    @classmethod
    def from_geometry(cls, subject: TaskObject, rng: np.random.Generator) -> Self:
        """Return antipodal grasps that nobody tried in physics, and geometric false ones.

        Raises ValueError where the object has no grasp.
        """
        labels = sample_grasps(subject.body, rng, positives=GEOMETRIC_GRASPS, negatives=3)
        steady = GraspJudge(subject.body.mesh).steadiness(labels.X_OGs, labels.openings_m, rng)
        weights = np.maximum(labels.qualities * steady**2, MIN_WEIGHT)
        return cls._with_false(subject.body, labels.X_OGs, labels.openings_m, weights, rng)

    @classmethod
    def from_checked(
        cls, subject: TaskObject, checked: CheckedGrasps, rng: np.random.Generator
    ) -> Self:
        """Return the grasps tried in physics, and geometric false ones.

        An object that is its own mirror image has the mirror images of grasps, too.

        The weight of a grasp that holds is its robustness in physics times its squared steadiness:
        grasps that a small error spoils are taught less often.
        """
        body = subject.body
        tried = checked.with_mirror_images() if subject.mirrored else checked
        steady = GraspJudge(body.mesh).steadiness(tried.X_OGs, tried.openings_m, rng)
        weights = np.maximum(tried.robustness * steady**2, MIN_WEIGHT) * tried.holds
        return cls._with_false(body, tried.X_OGs, tried.openings_m, weights, rng)

    @classmethod
    def _with_false(
        cls,
        body: RigidObject,
        X_OGs: Array,
        openings_m: Array,
        weights: Array,
        rng: np.random.Generator,
    ) -> Self:
        """Return grasps (N, 4, 4) with their weights (N,), and false ones beside them."""
        false = false_grasps(body, X_OGs[weights > 0.0], FALSE_GRASPS, rng)
        return cls(
            body,
            np.concatenate([X_OGs, false.X_OGs]),
            np.concatenate([openings_m, false.openings_m]),
            np.concatenate([weights, np.zeros(len(false.X_OGs))]),
        )

    @property
    def X_OPs(self) -> Array:
        """(L, 4, 4): the grasps."""
        return self.X_OGs

    def states(self, scene: ObjectScene) -> NDArray[np.uint8]:
        """Return (L,) the `PoseState` of each candidate.

        True are those that hold in physics, clear the table, come from above, and are visible.
        """
        true = (
            (self.weights > 0.0)
            & reachable(scene.X_WO, self.X_OGs, self._p_OCorners, scene.table_z_m)
            & self._visibility.visible(scene.X_WO, scene.p_WPs)
        )
        return np.where(true, np.uint8(PoseState.TRUE), np.uint8(PoseState.FALSE))

    @cached_property
    def _p_OCorners(self) -> Array:
        return hand_corners(self.X_OGs, self.openings_m)

    @cached_property
    def _visibility(self) -> GraspVisibility:
        return GraspVisibility(self.body.mesh, self.X_OGs, self.openings_m)
