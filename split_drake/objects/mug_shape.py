"""Mugs: a body with a handle that a peg goes through."""

from dataclasses import dataclass

import numpy as np

from split_drake.bad_input import BadInputError
from split_drake.objects.handle_points import HandlePoints
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import TaskObject
from split_drake.pose_task import HANDLE, UPRIGHT
from split_drake.poses import Array


class InvalidMugError(BadInputError):
    """The parameters describe no usable mug; the message starts with the reason."""


@dataclass(frozen=True, kw_only=True)
class MugShape(TaskObject):
    """A mug: the object and where its handle's opening is.  Its upright frame U is O.

    O has its origin at the centre of the base, z towards the rim and x towards the handle.

    Attributes:
        opening_OPs: (M, 3) closed outline of the handle's opening in the plane y = 0 of O, from
            the mesh.
        outer_diameter_m: largest diameter of the body without its handle.
    """

    opening_OPs: Array
    outer_diameter_m: float

    @classmethod
    def of(
        cls,
        body: RigidObject,
        X_OH: Array,
        opening_OPs: Array,
        outer_diameter_m: float,
        split: str = "",
        number: int = 0,
    ) -> "MugShape":
        """Return the mug whose handle frame H is at X_OH (4, 4)."""
        return cls(
            body=body,
            X_OPs={HANDLE: X_OH[None], UPRIGHT: np.eye(4)[None]},
            mirrored=True,
            opening_OPs=opening_OPs,
            outer_diameter_m=outer_diameter_m,
            split=split,
            number=number,
        )

    @property
    def X_OH(self) -> Array:
        """(4, 4): the handle frame H in O; H Rot_x(pi) is the same handle."""
        return self.poses_of(HANDLE)[0]

    def feature(self) -> HandlePoints:
        """Return the handle."""
        return HandlePoints(self.body.mesh)
