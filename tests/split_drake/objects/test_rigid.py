"""Rigid bodies: another mass, another size."""

import numpy as np
import pytest
import trimesh

from split_drake.objects.rigid import Kind, Primitive, RigidObject
from split_drake.poses import make_pose, rotation_z
from split_drake.station.station import Station
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION

X_OP = make_pose(rotation_z(0.3), (0.01, -0.02, 0.03))
CORNERS = trimesh.creation.box((0.02, 0.03, 0.04)).vertices


def plank(edges_m: tuple[float, float, float] = (0.04, 0.06, 0.1)) -> RigidObject:
    """Return a plank of a density of 500 kg/m^3 that stands on O's origin."""
    x, y, z = edges_m
    mass_kg = 500.0 * x * y * z
    mesh = trimesh.creation.box(edges_m)
    mesh.apply_translation((0.0, 0.0, z / 2.0))
    middle = np.array([0.0, 0.0, z / 2.0])
    return RigidObject(
        name="plank",
        mesh=mesh,
        mass_kg=mass_kg,
        p_OCom=middle,
        inertia_kg_m2=mass_kg / 12.0 * np.diag([y**2 + z**2, x**2 + z**2, x**2 + y**2]),
        collision=(Primitive("box", edges_m, make_pose(p=middle)),),
    )


def test_a_scaled_body_is_the_body_of_that_size() -> None:
    scaled, built = plank().scaled(0.5), plank((0.02, 0.03, 0.05))
    assert scaled.name == "plank"
    assert scaled.mass_kg == pytest.approx(built.mass_kg)
    np.testing.assert_allclose(scaled.p_OCom, built.p_OCom)
    np.testing.assert_allclose(scaled.inertia_kg_m2, built.inertia_kg_m2)
    np.testing.assert_allclose(scaled.mesh.bounds, built.mesh.bounds)
    (piece,), (expected,) = scaled.collision, built.collision
    assert piece.size == pytest.approx(expected.size)
    np.testing.assert_allclose(piece.X_OP, expected.X_OP)


def test_scaling_leaves_the_body_as_it_was() -> None:
    body = plank()
    before = body.mesh.bounds.copy()
    body.scaled(2.0)
    np.testing.assert_array_equal(body.mesh.bounds, before)
    assert body.collision[0].size == (0.04, 0.06, 0.1)


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("box", (0.02, 0.03, 0.04)),
        ("cylinder", (0.02, 0.05)),
        ("capsule", (0.01, 0.04)),
        ("sphere", (0.03,)),
    ],
)
def test_pieces_grow_about_the_objects_origin(kind: Kind, size: tuple[float, ...]) -> None:
    piece = Primitive(kind, size, X_OP).scaled(2.0)
    assert piece.kind == kind
    assert piece.size == tuple(2.0 * value for value in size)
    np.testing.assert_allclose(piece.X_OP[:3, 3], 2.0 * X_OP[:3, 3])
    np.testing.assert_array_equal(piece.X_OP[:3, :3], X_OP[:3, :3])


def test_convex_pieces_grow_with_their_vertices() -> None:
    piece = Primitive("convex", (), X_OP, CORNERS).scaled(1.5)
    np.testing.assert_allclose(piece.p_PVs, 1.5 * CORNERS)
    np.testing.assert_allclose(piece.X_OP[:3, 3], 1.5 * X_OP[:3, 3])


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan")])
def test_impossible_factors_are_named(factor: float) -> None:
    with pytest.raises(ValueError, match=f"factor is {factor}; expected more than 0"):
        plank().scaled(factor)


def test_a_heavier_body_resists_turning_as_much_more() -> None:
    heavy = plank().with_mass(2.0 * plank().mass_kg)
    np.testing.assert_allclose(heavy.inertia_kg_m2, 2.0 * plank().inertia_kg_m2)
    assert heavy.mass_kg == 2.0 * plank().mass_kg
    np.testing.assert_array_equal(heavy.mesh.bounds, plank().mesh.bounds)


def test_a_scaled_body_stands_on_the_table_where_its_mesh_ends() -> None:
    body = plank().scaled(0.6)
    station = Station(STATION, [body])
    station.place_object(0, make_pose(p=(0.5, 0.0, 0.0)))
    station.advance(0.5)
    assert np.abs(Truth(station).X_WO(0)[:3, 3] - (0.5, 0.0, 0.0)).max() < 0.001
