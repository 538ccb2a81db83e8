"""What training is told of the poses of one task on one object, scene by scene."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from split_drake.data.object_scenes import ObjectScene
from split_drake.poses import Array


class PoseState(IntEnum):
    """What a labelled pose is in a scene."""

    PADDING = 0
    TRUE = 1
    FALSE = 2


class PoseLabels(Protocol):
    """Poses on an object that are true or false, depending on the scene or wherever it lies."""

    @property
    def X_OPs(self) -> Array:
        """(L, 4, 4) the poses in O."""
        ...

    @property
    def weights(self) -> Array:
        """(L,) how often to learn a pose where it is true, in (0, 1]; 0 where it never is."""
        ...

    @property
    def least_true(self) -> int:
        """How many of the poses must be true in a scene for it to be of use."""
        ...

    def states(self, scene: ObjectScene) -> NDArray[np.uint8]:
        """Return (L,) the `PoseState` of each pose in a scene of the object."""
        ...


@dataclass(frozen=True)
class FixedPoses:
    """Poses that are true wherever the object lies.

    Attributes:
        X_OPs: (L, 4, 4) the poses in O.
    """

    X_OPs: Array
    least_true: int = 1

    @property
    def weights(self) -> Array:
        """(L,): all the same."""
        return np.ones(len(self.X_OPs))

    def states(self, scene: ObjectScene) -> NDArray[np.uint8]:
        """Return (L,): all true."""
        return np.full(len(self.X_OPs), PoseState.TRUE, dtype=np.uint8)
