"""The free-floating hand: where it goes, what it pushes and holds, what is seen of it."""

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiagramBuilder, EventStatus

from split_drake.camera import Intrinsics, look_at
from split_drake.poses import Array, make_pose, rotation_error_rad, rotation_y, rotation_z
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.panda import GRIPPER_FRAME, HAND_BODIES, add_panda
from split_drake.station.hand.hand_model import GANTRY_FORCE_N
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import CameraPlacement, Layout
from split_drake.station.steps import add_plant
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION
from tests.split_drake.station.solids import (
    DOWN,
    clear,
    solid_box,
    solids,
    stand,
)

TALL, CAN, FLAT, TIN, CUBE, HEAVY = range(6)


@pytest.fixture(scope="module")
def shared() -> HandStation:
    heavy = solid_box("heavy", (0.12, 0.12, 0.12), 30.0)
    return HandStation([*solids(), heavy], Layout())


@pytest.fixture
def station(shared: HandStation) -> HandStation:
    clear(shared)
    return shared


def _hand_path(station: HandStation, p_WG: Array) -> Array:
    """Move the hand, and return p_WG (N, 3) after each of the plant's steps."""
    points: list[Array] = []
    frame = station.plant.GetFrameByName(GRIPPER_FRAME)

    def watch(root: Context) -> EventStatus:
        context = station.plant.GetMyContextFromRoot(root)
        points.append(frame.CalcPoseInWorld(context).translation())
        return EventStatus.DidNothing()

    station.simulator.set_monitor(watch)
    station.move(p_WG)
    station.simulator.clear_monitor()
    return np.array(points)


def _distances_from_line(p_WPs: Array, start: Array, end: Array) -> Array:
    along = (end - start) / np.linalg.norm(end - start)
    offsets = p_WPs - start
    return np.linalg.norm(offsets - np.outer(offsets @ along, along), axis=1)


@pytest.mark.parametrize("R_WG", [DOWN, rotation_z(0.4) @ rotation_y(np.pi / 2.0)])
def test_hand_follows_a_straight_line_and_keeps_its_orientation(
    station: HandStation, R_WG: Array
) -> None:
    start, end = np.array([0.4, -0.1, 0.3]), np.array([0.55, 0.1, 0.2])
    station.place_hand(make_pose(R_WG, start))
    began_s = station.time_s
    path = _hand_path(station, end)
    assert _distances_from_line(path, start, end).max() < 2e-4
    assert np.linalg.norm(station.X_WG[:3, 3] - end) < 1e-3
    assert rotation_error_rad(station.X_WG[:3, :3], R_WG) < 1e-7
    length_m = float(np.linalg.norm(end - start))
    assert station.time_s - began_s == pytest.approx(length_m / 0.1 + 0.05, abs=0.011)


def test_hand_stops_where_it_first_touches(station: HandStation) -> None:
    stand(station, CUBE)
    station.advance(0.2)
    X_WO = Truth(station).X_WO(CUBE)
    station.place_hand(make_pose(DOWN, (0.5, 0.045, 0.2)))
    assert not station.move((0.5, 0.045, 0.02), stop_at_contact=True)
    assert station.touching() == {"cube"}
    station.advance(0.2)
    # The pads reach 11 mm beyond G.
    assert station.X_WG[2, 3] == pytest.approx(0.05 + 0.011, abs=1.5e-3)
    np.testing.assert_allclose(Truth(station).X_WO(CUBE), X_WO, atol=1e-3)


def test_hand_that_touches_already_does_not_move(station: HandStation) -> None:
    stand(station, CUBE)
    station.place_hand(make_pose(DOWN, (0.5, 0.03, 0.03)))
    assert not station.move((0.5, 0.0, 0.3), stop_at_contact=True)
    np.testing.assert_allclose(station.X_WG[:3, 3], (0.5, 0.03, 0.03), atol=1e-9)


def test_hand_holds_a_box_and_lets_it_go(station: HandStation) -> None:
    truth = Truth(station)
    stand(station, TALL)
    station.place_hand(make_pose(DOWN, (0.5, 0.0, 0.1)))
    station.close()
    station.move((0.5, 0.0, 0.3))
    station.advance(0.2)
    X_WO = truth.X_WO(TALL)
    assert X_WO[2, 3] > 0.25
    weight_n = 0.3 * 9.81
    assert station.gantry_force_n == pytest.approx([0.0, 0.0, weight_n], abs=0.1)
    station.advance(2.0)
    assert np.linalg.norm(truth.X_WO(TALL)[:3, 3] - X_WO[:3, 3]) < 1e-3
    assert station.touching() == {"tall"}
    station.grip(MAX_OPENING_M)
    station.advance(0.5)
    assert truth.X_WO(TALL)[2, 3] < 0.1


def test_hand_takes_only_what_it_grips(station: HandStation) -> None:
    truth = Truth(station)
    stand(station, CUBE)
    stand(station, FLAT, y=0.12)
    station.place_hand(make_pose(DOWN, (0.5, 0.0, 0.03)))
    station.close()
    station.move((0.5, 0.0, 0.2))
    assert station.touching() == {"cube"}
    assert truth.X_WO(FLAT)[:3, 3] == pytest.approx([0.5, 0.12, 0.03], abs=1e-3)


def test_closing_on_nothing_closes_all_the_way(station: HandStation) -> None:
    station.place_hand(make_pose(DOWN, (0.5, 0.0, 0.2)))
    station.close()
    assert station.opening_m == pytest.approx(0.0, abs=1e-4)
    assert not station.touching()


def test_hand_pushes_a_box_along(station: HandStation) -> None:
    truth = Truth(station)
    stand(station, CUBE)
    start, end = np.array([0.44, 0.0, 0.02]), np.array([0.56, 0.0, 0.02])
    station.place_hand(make_pose(DOWN, start), opening_m=0.0)
    path = _hand_path(station, end)
    # The pads are 2 cm wide.
    assert truth.X_WO(CUBE)[0, 3] == pytest.approx(0.56 + 0.01 + 0.025, abs=3e-3)
    assert _distances_from_line(path, start, end).max() < 2e-3
    assert np.linalg.norm(station.X_WG[:3, 3] - end) < 2e-3


def test_hand_gives_way_to_what_it_cannot_push(station: HandStation) -> None:
    stand(station, HEAVY)
    station.advance(0.1)
    X_WO = Truth(station).X_WO(HEAVY)
    station.place_hand(make_pose(DOWN, (0.4, 0.0, 0.06)), opening_m=0.0)
    station.move((0.5, 0.0, 0.06))
    assert np.abs(station.gantry_force_n).max() <= GANTRY_FORCE_N + 1e-6
    assert station.X_WG[0, 3] < 0.44
    np.testing.assert_allclose(Truth(station).X_WO(HEAVY), X_WO, atol=0.01)
    station.move((0.4, 0.0, 0.06))
    station.advance(0.2)
    assert np.linalg.norm(station.X_WG[:3, 3] - (0.4, 0.0, 0.06)) < 1e-3


def test_parked_things_stay_where_they_are_and_are_not_seen(station: HandStation) -> None:
    truth = Truth(station)
    stand(station, TALL)
    before = [truth.X_WO(index) for index in range(1, 6)]
    assert station.present == (TALL,)
    station.advance(0.5)
    for index, X_WO in enumerate(before, start=1):
        np.testing.assert_allclose(truth.X_WO(index), X_WO, atol=1e-12)
    top = Layout().cameras[0]
    (with_box,) = station.capture([top])
    station.park_object(TALL)
    (empty,) = station.capture([top])
    assert with_box.depth_m.min() == pytest.approx(0.6 - 0.12, abs=1e-3)
    assert empty.depth_m.min() == pytest.approx(0.6, abs=1e-3)


def test_what_is_discarded_touches_nothing_and_cannot_come_back() -> None:
    station = HandStation(solids(), Layout())
    clear(station)
    stand(station, TALL)
    station.discard_parked()
    # Where a parked object is, the hand touches nothing; where one stands, it does.
    station.place_hand(Truth(station).X_WO(CAN))
    assert not station.touching()
    station.place_hand(Truth(station).X_WO(TALL))
    assert "tall" in station.touching()
    station.park_hand()
    station.advance(0.2)
    assert Truth(station).X_WO(TALL)[2, 3] > -0.01
    with pytest.raises(ValueError, match="object 1 was discarded"):
        station.place_object(CAN, make_pose(p=(0.5, 0.0, 0.1)))


def test_cameras_stand_anywhere_from_one_picture_to_the_next(station: HandStation) -> None:
    stand(station, CUBE)
    station.advance(0.1)
    intrinsics = Intrinsics.centered(160, 120, focal_px=135.0)
    for azimuth in (0.3, 2.0):
        away = rotation_z(azimuth) @ (0.3, 0.0, 0.4)
        X_WC = look_at(np.array([0.5, 0.0, 0.05]) + away, (0.5, 0.0, 0.05))
        (view,) = station.capture([CameraPlacement("any", intrinsics, X_WC)])
        points = view.points()
        on_cube = points[np.abs(points - (0.5, 0.0, 0.025)).max(axis=1) < 0.04]
        assert on_cube[:, 2].max() == pytest.approx(0.05, abs=1e-3)
        assert np.abs(on_cube[on_cube[:, 2] > 0.005, :2] - (0.5, 0.0)).max() < 0.0265
    assert station.photograph(intrinsics, X_WC).shape == (120, 160, 3)


def test_pictures_show_a_hand_that_is_not_parked(station: HandStation) -> None:
    top = Layout().cameras[0]
    station.place_hand(make_pose(DOWN, (0.5, 0.0, 0.2)))
    (view,) = station.capture([top])
    assert view.depth_m.min() < 0.4


def test_hand_is_that_of_the_arm() -> None:
    config = STATION
    whole, scene_graph = add_plant(DiagramBuilder(), config)
    add_panda(whole)
    station = HandStation([], Layout())
    assert not station.plant.HasBodyNamed("panda_link7")
    inspector = station.diagram.GetSubsystemByName("scene_graph").model_inspector()

    def shapes(plant: MultibodyPlant, name: str) -> list[str]:
        found = inspector if plant is station.plant else scene_graph.model_inspector()
        geometries = plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name))
        poses = [found.GetPoseInFrame(g).GetAsMatrix4().round(9).tolist() for g in geometries]
        return [f"{found.GetShape(g)} {X}" for g, X in zip(geometries, poses, strict=True)]

    for name in HAND_BODIES:
        assert shapes(station.plant, name) == shapes(whole, name)


def test_motion_is_published_to_meshcat() -> None:
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    station = HandStation([solid_box("cube", (0.05,) * 3)], Layout(), meshcat=meshcat)
    meshcat.StartRecording(frames_per_second=20.0)
    station.place_hand(make_pose(DOWN, (0.5, 0.0, 0.2)))
    station.move((0.5, 0.0, 0.19))
    meshcat.PublishRecording()
    assert meshcat.HasPath("/drake/visualizer/panda/panda_hand")
    assert meshcat.HasPath("/drake/visualizer/cube")


def test_hand_goes_where_a_network_in_single_precision_says(station: HandStation) -> None:
    X_WG = make_pose(rotation_z(0.3) @ DOWN, (0.5, 0.1, 0.2)).astype(np.float32)
    station.place_hand(X_WG)
    np.testing.assert_allclose(station.X_WG, X_WG, atol=1e-6)


def test_impossible_commands_are_refused(station: HandStation) -> None:
    with pytest.raises(ValueError, match=r"opening_m is 0\.1"):
        station.place_hand(make_pose(DOWN, (0.5, 0.0, 0.2)), opening_m=0.1)
    with pytest.raises(ValueError, match="X_WG holds NaN"):
        station.place_hand(np.full((4, 4), np.nan))
    with pytest.raises(ValueError, match="p_WG is"):
        station.move((0.5, 0.0))
    with pytest.raises(ValueError, match="speed_m_s is 0"):
        station.move((0.5, 0.0, 0.2), speed_m_s=0.0)
    with pytest.raises(ValueError, match="force_n is 41"):
        station.grip(0.0, 41.0)
    with pytest.raises(ValueError, match=r"opening_m is 0\.2"):
        station.grip(0.2)
    with pytest.raises(ValueError, match="name"):
        HandStation([solid_box("twin", (0.05,) * 3)] * 2, Layout())
