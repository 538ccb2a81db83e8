"""Rigid objects that are put on the table: mesh, mass and collision geometry."""

from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np
import trimesh

from split_drake.bad_input import LARGEST
from split_drake.poses import Array

Kind = Literal["box", "cylinder", "capsule", "sphere", "convex"]

_SIZE_MEANS: dict[str, str] = {
    "box": "edges along x, y and z",
    "cylinder": "radius and length",
    "capsule": "radius and length",
    "sphere": "a radius",
    "convex": "nothing",
}
_SIZE_COUNTS = {"box": 3, "cylinder": 2, "capsule": 2, "sphere": 1, "convex": 0}
# Vertices within this of a plane span no volume.
_FLAT_M = 1e-6


@dataclass(frozen=True)
class Primitive:
    """A convex collision shape P fixed to an object O.

    Attributes:
        kind: the shape.
        size: box: edges along x, y, z; cylinder and capsule: (radius, length along z), a capsule's
            length without its caps; sphere: (radius,); convex: empty.  Metres.
        X_OP: (4, 4) pose of its centre; of the frame of its vertices where it is convex.
        p_PVs: convex: (N, 3) points whose convex hull it is, metres; else (0, 3).

    Raises ValueError where the kind is unknown, or the numbers do not describe one of its kind.
    """

    kind: Kind
    size: tuple[float, ...]
    X_OP: Array
    p_PVs: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        if self.kind not in _SIZE_COUNTS:
            raise ValueError(f"kind is {self.kind!r}; expected one of {tuple(_SIZE_COUNTS)}")
        if len(self.size) != _SIZE_COUNTS[self.kind]:
            raise ValueError(
                f"size of a {self.kind} is {self.size}; expected {_SIZE_MEANS[self.kind]}"
            )
        if not all(np.isfinite(value) and value > 0.0 for value in self.size):
            raise ValueError(f"size of a {self.kind} is {self.size}; expected positive numbers")
        if np.shape(self.X_OP) != (4, 4) or not np.isfinite(self.X_OP).all():
            raise ValueError(f"X_OP of a {self.kind} is no pose; expected (4, 4) finite numbers")
        self._check_vertices()

    def scaled(self, factor: float) -> Self:
        """Return the shape `factor` times as large, and as far from O's origin."""
        X_OP = np.array(self.X_OP, dtype=float)
        X_OP[:3, 3] *= factor
        size = tuple(factor * value for value in self.size)
        return replace(self, size=size, X_OP=X_OP, p_PVs=factor * np.asarray(self.p_PVs))

    def _check_vertices(self) -> None:
        shape = np.shape(self.p_PVs)
        if self.kind != "convex":
            if shape != (0, 3):
                raise ValueError(f"p_PVs of a {self.kind} has shape {shape}; expected (0, 3)")
            return
        if len(shape) != 2 or shape[1] != 3 or shape[0] < 4:
            raise ValueError(f"p_PVs has shape {shape}; expected (N, 3) of at least 4 vertices")
        if not np.isfinite(self.p_PVs).all():
            raise ValueError("p_PVs holds NaN or infinite values; expected finite points")
        if is_flat(self.p_PVs):
            raise ValueError("p_PVs lie in one plane; expected vertices that span a volume")


def is_flat(points: Array) -> bool:
    """Return whether points (N, 3) lie in one plane, nearly, so that they span no volume."""
    offsets = points - np.mean(points, axis=0)
    thickness_m = np.linalg.svd(offsets, compute_uv=False)[-1] / np.sqrt(len(offsets))
    return bool(thickness_m < _FLAT_M)


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
        if not 0.0 < self.mass_kg < LARGEST:
            raise ValueError(f"mass_kg of {self.name} is {self.mass_kg}; expected more than 0")
        if not self.collision:
            raise ValueError(f"{self.name} has no collision geometry")

    def scaled(self, factor: float) -> Self:
        """Return the body `factor` times as large in O, of the same density."""
        if not 0.0 < factor < LARGEST:
            raise ValueError(f"factor is {factor}; expected more than 0")
        mesh = self.mesh.copy()
        mesh.apply_scale(factor)
        return replace(
            self,
            mesh=mesh,
            mass_kg=self.mass_kg * factor**3,
            p_OCom=factor * np.asarray(self.p_OCom),
            inertia_kg_m2=self.inertia_kg_m2 * factor**5,
            collision=tuple(piece.scaled(factor) for piece in self.collision),
        )

    def with_mass(self, mass_kg: float) -> Self:
        """Return the body as heavy as given, its mass distributed as before."""
        inertia = self.inertia_kg_m2 * (mass_kg / self.mass_kg)
        return replace(self, mass_kg=mass_kg, inertia_kg_m2=inertia)
