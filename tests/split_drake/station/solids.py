"""Boxes and cylinders for tests of the clutter station."""

from collections.abc import Sequence

import numpy as np
import trimesh

from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.poses import Array, make_pose, rotation_x
from split_drake.station.hand.hand_station import HandStation

DOWN: Array = rotation_x(np.pi)


def solid_box(name: str, edges_m: Sequence[float], mass_kg: float = 0.3) -> RigidObject:
    """Return a box with its origin in its centre."""
    x, y, z = edges_m
    inertia = mass_kg / 12.0 * np.diag([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    piece = Primitive("box", (x, y, z), np.eye(4))
    return RigidObject(name, trimesh.creation.box(edges_m), mass_kg, np.zeros(3), inertia, (piece,))


def solid_cylinder(
    name: str, radius_m: float, height_m: float, mass_kg: float = 0.2
) -> RigidObject:
    """Return a cylinder with its origin in the middle of its base, z along its axis."""
    across = mass_kg * (3.0 * radius_m**2 + height_m**2) / 12.0
    inertia = np.diag([across, across, mass_kg * radius_m**2 / 2.0])
    mesh = trimesh.creation.cylinder(radius_m, height_m)
    mesh.apply_translation((0.0, 0.0, height_m / 2.0))
    middle = np.array([0.0, 0.0, height_m / 2.0])
    piece = Primitive("cylinder", (radius_m, height_m), make_pose(p=middle))
    return RigidObject(name, mesh, mass_kg, middle, inertia, (piece,))


def solids() -> list[RigidObject]:
    """Return five objects that a hand can take."""
    return [
        solid_box("tall", (0.05, 0.05, 0.12)),
        solid_cylinder("can", 0.03, 0.12),
        solid_box("flat", (0.04, 0.08, 0.06), 0.2),
        solid_cylinder("tin", 0.025, 0.06, 0.1),
        solid_box("cube", (0.05, 0.05, 0.05), 0.15),
    ]


def stand(station: HandStation, index: int, x: float = 0.5, y: float = 0.0) -> None:
    """Stand an object on the table."""
    z = 0.0005 - float(station.objects[index].mesh.bounds[0][2])
    station.place_object(index, make_pose(p=(x, y, z)))


def clear(station: HandStation) -> None:
    """Park everything."""
    station.park_hand()
    for index in station.present:
        station.park_object(index)
