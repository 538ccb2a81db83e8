"""Who touches what, and how deep, whatever the contact model."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from split_drake.robot.panda import FINGER_BODIES, GRIPPER_FRAME
from split_drake.robot.posture import Q_HOME
from split_drake.station.config import ContactModel
from split_drake.station.contacts import contacts_of, penetration_m
from split_drake.station.station import Station
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION

EDGE_M = 0.04


def cube(name: str) -> RigidObject:
    """Return a cube of 300 g with its origin in its centre."""
    mesh, edges = trimesh.creation.box((EDGE_M,) * 3), (EDGE_M,) * 3
    inertia = np.eye(3) * 0.3 * EDGE_M**2 / 6.0
    return RigidObject(name, mesh, 0.3, np.zeros(3), inertia, (Primitive("box", edges, np.eye(4)),))


def at(x: float, z: float) -> Array:
    return make_pose(p=(x, 0.0, z))


@pytest.mark.parametrize("model", ["point", "hydroelastic_with_fallback"])
def test_pads_touch_what_they_hold_on_both_of_its_sides(model: ContactModel) -> None:
    station = Station(replace(STATION, contact_model=model), [cube("held")])
    truth = Truth(station)
    station.set_arm(Q_HOME, EDGE_M + 0.001)
    gripper = station.plant.GetFrameByName(GRIPPER_FRAME)
    station.place_object(0, gripper.CalcPoseInWorld(station.plant_context).GetAsMatrix4())
    station.command(Q_HOME, np.zeros(7), -0.02, 40.0)
    station.advance(0.3)
    assert truth.touching() == set(FINGER_BODIES)
    for contact in truth.contacts():
        x, y, z = transform_points(invert_pose(truth.X_WO()), contact.p_WC[None])[0]
        side = 1.0 if contact.body == FINGER_BODIES[0] else -1.0
        assert side * y == pytest.approx(EDGE_M / 2.0, abs=0.001)
        assert max(abs(x), abs(z)) < EDGE_M / 2.0
    assert 0.0 < truth.penetration_m(FINGER_BODIES) < 0.001
    assert truth.robot_depths_m() == (
        pytest.approx(truth.penetration_m(FINGER_BODIES), rel=1e-3),
        0.0,
    )


def test_depths_are_those_of_the_deepest_pair_of_the_bodies_named() -> None:
    station = Station(STATION, [cube("one"), cube("two"), cube("three")])
    plant, context = station.plant, station.plant_context
    for index, X_WO in enumerate((at(0.5, 0.2), at(0.5, 0.2 + EDGE_M - 0.003), at(0.5, 0.5))):
        station.place_object(index, X_WO)
    assert penetration_m(plant, context, {"one"}, {"two"}) == pytest.approx(0.003)
    assert penetration_m(plant, context, {"two"}, {"one", "three"}) == pytest.approx(0.003)
    assert penetration_m(plant, context, {"one", "two"}, {"three"}) == 0.0
    assert penetration_m(plant, context, set(), {"one"}) == 0.0
    for beside_m, above_m in ((0.005, 0.003), (0.003, 0.005)):
        station.place_object(1, at(0.5, 0.2 + EDGE_M - above_m))
        station.place_object(2, at(0.5 + EDGE_M - beside_m, 0.2))
        assert penetration_m(plant, context, {"one"}, {"two", "three"}) == pytest.approx(0.005)
    with pytest.raises(RuntimeError, match="four"):
        penetration_m(plant, context, {"four"}, {"one"})


def test_contacts_are_those_of_one_body_and_name_the_other() -> None:
    station = Station(STATION, [cube("lower"), cube("upper")])
    station.place_object(0, at(0.5, EDGE_M / 2.0))
    station.place_object(1, at(0.5, 1.5 * EDGE_M))
    station.advance(0.1)
    touched = [
        {name for name, _ in contacts_of(station.plant, station.plant_context, body)}
        for body in (station.object_body(0), station.object_body(1))
    ]
    assert touched == [{"table", "upper"}, {"lower"}]
