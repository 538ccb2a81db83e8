"""Rigid objects that are put on the table: mesh, mass and collision geometry."""

from dataclasses import dataclass, replace
from typing import Literal, Self

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
