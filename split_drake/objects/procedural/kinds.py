"""The kinds of shapes: functions by name that draw a shape from a random generator."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from split_drake.objects.convex_pieces import pieces_that_rest
from split_drake.objects.meshes.mass import mass_properties
from split_drake.objects.procedural.shape import Shape, moved
from split_drake.objects.rigid import RigidObject
from split_drake.poses import make_pose

Trait = Literal["hollow", "flat", "long", "round", "composed"]
Builder = Callable[[np.random.Generator], Shape]

DENSITY_KG_M3 = (100.0, 1000.0)
MASS_KG = (0.02, 1.0)


@dataclass(frozen=True)
class Kind:
    """One kind of shapes.

    Attributes:
        name: unique.
        traits: what its shapes have in common with those of other kinds.
        build: draws one, standing as it would on a table: z up.
    """

    name: str
    traits: tuple[Trait, ...]
    build: Builder


KINDS: dict[str, Kind] = {}


def kind(name: str, *traits: Trait) -> Callable[[Builder], Builder]:
    """Return a decorator that makes a function the kind `name`.

    Raises ValueError where that name is taken.
    """

    def register(build: Builder) -> Builder:
        if name in KINDS:
            raise ValueError(f"there are two kinds called {name!r}; expected different names")
        KINDS[name] = Kind(name, traits, build)
        return build

    return register


def build_body(kind_name: str, seed: int, name: str = "") -> RigidObject:
    """Return the shape of a kind that `seed` draws, as a body called `name` or "kind_seed".

    O lies below the middle of the shape's bounding box, on the plane that it stands on, z up.
    Density is drawn too; the mass is kept within `MASS_KG`.

    Raises ValueError where there is no such kind.
    """
    if kind_name not in KINDS:
        raise ValueError(f"no kind is called {kind_name!r}; expected one of {', '.join(KINDS)}")
    rng = np.random.default_rng([zlib.crc32(kind_name.encode()), seed])
    shape = _on_its_foot(KINDS[kind_name].build(rng))
    mass_kg = float(np.clip(shape.mesh.volume * rng.uniform(*DENSITY_KG_M3), *MASS_KG))
    p_OCom, inertia_kg_m2 = mass_properties(shape.mesh, mass_kg)
    return RigidObject(
        name=name or f"{kind_name}_{seed}",
        mesh=shape.mesh,
        mass_kg=mass_kg,
        p_OCom=p_OCom,
        inertia_kg_m2=inertia_kg_m2,
        collision=pieces_that_rest(shape.hulls),
    )


def _on_its_foot(shape: Shape) -> Shape:
    lower, upper = shape.mesh.bounds
    x, y, _ = -(lower + upper) / 2.0
    return moved(shape, make_pose(p=(x, y, -lower[2])))
