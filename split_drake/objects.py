"""Rigid objects that are put on the table: mesh, mass and collision geometry."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
import trimesh

from split_drake.poses import Array


@dataclass(frozen=True)
class Primitive:
    """A convex collision shape P fixed to an object O.

    Attributes:
        kind: the shape.
        size: box: edges along x, y, z; cylinder and capsule: (radius, length along z), a capsule's
            length without its caps; sphere: (radius,).  Metres.
        X_OP: (4, 4) pose of its centre.
    """

    kind: Literal["box", "cylinder", "capsule", "sphere"]
    size: tuple[float, ...]
    X_OP: Array


@dataclass(frozen=True)
class RigidObject:
    """A free body.

    Attributes:
        name: unique among the shapes of a run.
        mesh: in O, metres; what cameras see and what success is judged by.
        mass_kg: total mass.
        p_OCom: (3,) centre of mass.
        inertia_kg_m2: (3, 3) about the centre of mass, axes of O.
        collision: convex pieces that stand for the mesh in contact.
    """

    name: str
    mesh: trimesh.Trimesh
    mass_kg: float
    p_OCom: Array
    inertia_kg_m2: Array
    collision: tuple[Primitive, ...]

    def __post_init__(self) -> None:
        if not self.mass_kg > 0.0:
            raise ValueError(f"mass_kg of {self.name} is {self.mass_kg}; expected more than 0")
        if not self.collision:
            raise ValueError(f"{self.name} has no collision geometry")

    def with_mass(self, mass_kg: float) -> Self:
        """Return the body as heavy as given, its mass distributed as before."""
        inertia = self.inertia_kg_m2 * (mass_kg / self.mass_kg)
        return replace(self, mass_kg=mass_kg, inertia_kg_m2=inertia)


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
