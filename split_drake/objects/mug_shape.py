from dataclasses import dataclass

import numpy as np

from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array


class InvalidMugError(ValueError):
    """The parameters describe no usable mug; the message starts with the reason."""


@dataclass(frozen=True)
class MugShape:
    """A mug: the object and where its handle's opening is.  Its upright frame U is O.

    Attributes:
        body: the rigid object; O has its origin at the centre of the base, z towards the rim and x
            towards the handle.
        X_OH: (4, 4) pose of the handle frame H in O.
        opening_OPs: (M, 3) closed outline of the handle's opening in the plane y = 0 of O, from
            the mesh.
        outer_diameter_m: largest diameter of the body without its handle.
    """

    body: RigidObject
    X_OH: Array
    opening_OPs: Array
    outer_diameter_m: float

    def handle_poses(self, X_WO: Array) -> Array:
        """Return the (2, 4, 4) true handle poses of the mug at X_WO: H and H Rot_x(pi)."""
        X_WH = X_WO @ self.X_OH
        return np.stack([X_WH, X_WH @ np.diag([1.0, -1.0, -1.0, 1.0])])
