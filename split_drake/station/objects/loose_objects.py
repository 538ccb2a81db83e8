"""Free bodies of a plant that are put somewhere, or parked out of the way."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, RigidBody
from pydrake.systems.framework import Context

from split_drake.poses import check_poses

# Out of every camera's sight; what is parked there stands a metre apart.
PARKED_Z_M = -10.0


def put_body(
    plant: MultibodyPlant, context: Context, body: RigidBody, X_WB: RigidTransform
) -> None:
    """Put a free body at rest at a pose."""
    plant.SetFreeBodyPose(context, body, X_WB)
    plant.SetFreeBodySpatialVelocity(context=context, body=body, V_JpJc=SpatialVelocity.Zero())


def free_joint(plant: MultibodyPlant, body: RigidBody) -> Joint:
    """Return the joint that leaves a free body all its freedom."""
    (index,) = plant.GetJointIndices(body.model_instance())
    return plant.get_joint(index)


class LooseObjects:
    """The objects of a station, by their index; what is parked stays where it is."""

    def __init__(self, plant: MultibodyPlant, bodies: Sequence[RigidBody]) -> None:
        self._plant = plant
        self._bodies = tuple(bodies)
        self._present = set(range(len(bodies)))
        self._discarded: set[int] = set()

    @property
    def present(self) -> tuple[int, ...]:
        """Which objects are not parked, in order."""
        return tuple(sorted(self._present))

    def place(self, context: Context, index: int, X_WO: ArrayLike) -> None:
        """Put object `index` at rest at X_WO (4, 4), free to move.

        Raises ValueError where it was discarded.
        """
        if index in self._discarded:
            raise ValueError(f"object {index} was discarded; expected one that was not")
        pose, body = RigidTransform(check_poses(X_WO, "X_WO")), self._bodies[index]
        free_joint(self._plant, body).Unlock(context)
        put_body(self._plant, context, body, pose)
        self._present.add(index)

    def park(self, context: Context, index: int) -> None:
        """Take object `index` out of the way, wherever it is."""
        body = self._bodies[index]
        parked = RigidTransform(np.array([float(index), 0.0, PARKED_Z_M]))
        put_body(self._plant, context, body, parked)
        free_joint(self._plant, body).Lock(context)
        self._present.discard(index)

    def discard_parked(self, scene_graph: SceneGraph, geometry_context: Context) -> None:
        """Take what is parked out of the collisions of a context for good."""
        source = self._plant.get_source_id()
        for index in set(range(len(self._bodies))) - self._present - self._discarded:
            frame = self._plant.GetBodyFrameIdOrThrow(self._bodies[index].index())
            scene_graph.RemoveRole(geometry_context, source, frame, Role.kProximity)
            self._discarded.add(index)
