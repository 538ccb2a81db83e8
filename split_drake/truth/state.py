"""The simulator's state, which nothing but this room reads."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from pydrake.multibody.tree import RigidBody

from split_drake.poses import Array, transform_points
from split_drake.robot.panda import FINGER_BODIES, MOVING_BODIES
from split_drake.station.contacts import Overlaps, contacts_of, penetration_m
from split_drake.station.fixtures import HOOK_BODY, TABLE_BODY
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.station import Station

# With an arm, or with a hand alone.
AnyStation = Station | HandStation


@dataclass(frozen=True)
class ObjectContact:
    """A point where an object touches something.

    Attributes:
        body: name of the other body.
        p_WC: (3,) the point, metres in W.
    """

    body: str
    p_WC: Array


class Truth:
    """The true state of a station's objects, by their index."""

    def __init__(self, station: AnyStation) -> None:
        self._station = station
        self._plant = station.plant
        self._overlaps: dict[int, Overlaps] = {}

    def X_WO(self, index: int = 0) -> Array:
        """Return the pose of an object, (4, 4)."""
        pose = self._plant.EvalBodyPoseInWorld(self._station.plant_context, self._body(index))
        return pose.GetAsMatrix4()

    def p_WCom(self, index: int = 0) -> Array:
        """Return the centre of mass of an object, (3,) in W."""
        p_OCom = np.atleast_2d(self._station.objects[index].p_OCom)
        return transform_points(self.X_WO(index), p_OCom)[0]

    def velocity(self, index: int = 0) -> tuple[Array, Array]:
        """Return velocity (3,) in m/s and angular velocity (3,) in rad/s of an object, in W."""
        context = self._station.plant_context
        V_WO = self._plant.EvalBodySpatialVelocityInWorld(context, self._body(index))
        return V_WO.translational(), V_WO.rotational()

    def contacts(self, index: int = 0) -> tuple[ObjectContact, ...]:
        """Return all points where an object touches something, as of the last step."""
        found = contacts_of(
            self._plant, self._station.plant_context, self._station.object_body(index)
        )
        return tuple(ObjectContact(body, p_WC) for body, p_WC in found)

    def touching(self, index: int = 0) -> frozenset[str]:
        """Return the names of the bodies that an object touches."""
        return frozenset(contact.body for contact in self.contacts(index))

    def penetration_m(self, bodies: Collection[str], index: int = 0) -> float:
        """Return how deep an object's pieces overlap with the bodies of these names, 0 if not."""
        own = self._station.objects[index].name
        return penetration_m(self._plant, self._station.plant_context, bodies, {own})

    def robot_depths_m(self, index: int = 0) -> tuple[float, float]:
        """Return how deep the last step found the robot in what it should not sink into, or 0.

        That is the fingers with an object, and all of its moving bodies with table and hook.
        """
        if index not in self._overlaps:
            own, fixtures = {self._station.objects[index].name}, (TABLE_BODY, HOOK_BODY)
            groups = [(FINGER_BODIES, own), (MOVING_BODIES, fixtures)]
            self._overlaps[index] = Overlaps(self._plant, groups)
        depths_m = self._overlaps[index].depths_in_last_step_m(self._station.plant_context)
        return depths_m[0], depths_m[1]

    def _body(self, index: int) -> RigidBody:
        return self._plant.get_body(self._station.object_body(index))
