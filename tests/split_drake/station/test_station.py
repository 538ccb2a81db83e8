"""The station: tracking, gripper in SI, depth images, determinism, bad input."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from split_drake.camera import DepthView
from split_drake.data.render import DepthRenderer
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z
from split_drake.robot.gripper import MAX_FORCE_N, MAX_OPENING_M
from split_drake.robot.panda import GRIPPER_FRAME
from split_drake.robot.posture import Q_HOME
from split_drake.station.cameras.egl import RenderingUnavailableError, check_rendering
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION


def make_box(edge_m: float = 0.04, mass_kg: float = 0.3, name: str = "box") -> RigidObject:
    """Return a cube with its origin in its centre."""
    mesh = trimesh.creation.box((edge_m,) * 3)
    inertia = np.eye(3) * mass_kg * edge_m**2 / 6.0
    collision = (Primitive("box", (edge_m,) * 3, np.eye(4)),)
    return RigidObject(name, mesh, mass_kg, np.zeros(3), inertia, collision)


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("train_000")


def _hold(station: Station, box_opening_m: float, force_n: float) -> None:
    """Put the box into the hand and squeeze it."""
    gripper = station.plant.GetFrameByName(GRIPPER_FRAME)
    station.set_arm(Q_HOME, box_opening_m)
    X_WG = gripper.CalcPoseInWorld(station.plant_context).GetAsMatrix4()
    station.place_object(0, X_WG)
    station.command(Q_HOME, np.zeros(7), -0.02, force_n)


def test_arm_tracks_a_smooth_move_within_5_mrad() -> None:
    station = Station(STATION)
    step, amplitude = np.array([0.5, 0.3, -0.4, 0.5, 0.5, 0.4, -0.6]), np.pi / 1.2
    phases = amplitude * np.arange(0.0, 1.2, 0.01)
    qs = Q_HOME + step * (1.0 - np.cos(phases))[:, None] / 2.0
    vs = step * amplitude * np.sin(phases)[:, None] / 2.0
    errors = []
    for q, v, q_next in zip(qs[:-1], vs[:-1], qs[1:], strict=True):
        station.command(q, v, MAX_OPENING_M, MAX_FORCE_N)
        station.advance(0.01)
        errors.append(np.abs(station.q - q_next).max())
    assert max(errors) < 0.003
    np.testing.assert_allclose(station.q, Q_HOME + step, atol=2e-3)


@pytest.mark.parametrize("opening_m", [0.0, 0.03])
def test_opening_is_in_metres_between_the_pads(opening_m: float) -> None:
    station = Station(STATION)
    station.command(Q_HOME, np.zeros(7), opening_m, MAX_FORCE_N)
    station.advance(1.0)
    assert station.opening_m == pytest.approx(opening_m, abs=5e-4)


@pytest.mark.parametrize("force_n", [8.0, 40.0])
def test_squeezing_presses_with_the_force_asked_for(force_n: float) -> None:
    box = make_box()
    station = Station(STATION, [box])
    truth = Truth(station)
    _hold(station, 0.041, force_n)
    station.advance(0.6)
    X_start = truth.X_WO()
    assert station.finger_forces_n == pytest.approx([-force_n, -force_n], rel=0.02)
    assert station.opening_m == pytest.approx(0.04, abs=1e-3)
    station.advance(0.5)
    assert np.linalg.norm(truth.X_WO()[:3, 3] - X_start[:3, 3]) < 1e-3


def test_joint_torques_show_the_weight_that_is_held() -> None:
    box = make_box(mass_kg=0.4)
    station = Station(STATION, [box])
    _hold(station, 0.041, MAX_FORCE_N)
    station.advance(0.8)
    lever_m = station.plant.GetFrameByName(GRIPPER_FRAME).CalcPoseInWorld(station.plant_context)
    weight_n = 0.4 * 9.81
    x, _, _ = lever_m.translation()
    assert station.joint_torques_nm[1] == pytest.approx(-weight_n * x, rel=0.1)


def test_depth_of_the_table_is_the_cameras_height() -> None:
    top, side = Station(STATION).capture()
    assert np.median(np.abs(top.depth_m - 0.6)) < 1e-3
    assert np.abs(top.points()[:, 2]).max() < 1e-3
    points = side.points()
    on_table = points[np.all(np.abs(points - (0.55, 0.0, 0.0)) < (0.34, 0.4, 0.02), axis=1)]
    assert len(on_table) > 2e5
    assert np.abs(on_table[:, 2]).max() < 1e-3


def test_depth_agrees_with_the_training_renderer(mug: MugShape) -> None:
    station = Station(STATION, [mug.body])
    R_WO = rotation_z(0.7) @ rotation_x(1.2) @ rotation_y(0.4)
    X_WO = make_pose(R_WO, (0.5, 0.01, 0.08))
    station.place_object(0, X_WO)
    renderer, layout = DepthRenderer(mug.body.mesh), station.config.layout
    for view, camera in zip(station.capture(), layout.cameras, strict=True):
        _assert_same_depth(view, renderer.render(X_WO, camera), layout.workspace.edge_m)


def _assert_same_depth(actual: DepthView, expected: DepthView, edge_m: float) -> None:
    """Compare pixels around the workspace whose neighbours have nearly the same depth."""
    depth = expected.depth_m
    padded = np.pad(depth, 1, mode="edge")
    shifts = [padded[1 + i : 481 + i, 1 + j : 641 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    inner = np.ptp(np.stack(shifts), axis=0) < 0.006
    near = dataclasses.replace(expected, depth_m=np.where(inner, depth, 0.0))
    p_WPs = near.points() - (0.5, 0.0, 0.0)
    mask = inner.copy()
    mask[inner] = np.abs(p_WPs[:, :2]).max(axis=1) < edge_m / 2.0
    assert mask.sum() > 50_000
    above = mask.copy()
    above[mask] = np.abs(actual.depth_m - expected.depth_m)[mask] > 1e-3
    assert above.sum() == 0, f"{above.sum()} pixels differ by more than 1 mm"
    raised = p_WPs[:, 2] > 0.01
    assert raised.sum() > 3_000, "the mug is in the picture"


def test_same_start_gives_the_same_motion(mug: MugShape) -> None:
    poses = []
    for _ in range(2):
        station = Station(STATION, [mug.body])
        station.place_object(0, make_pose(rotation_x(1.0), (0.5, 0.0, 0.1)))
        station.advance(0.5)
        poses.append(Truth(station).X_WO())
    first, second = poses
    np.testing.assert_array_equal(first, second)


def test_commands_move_on_at_their_velocity_for_one_period() -> None:
    station = Station(STATION)
    v = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    system = station.diagram.GetSubsystemByName("command")
    desired = system.GetOutputPort("desired_state")
    station.command(Q_HOME, v, 0.08, 40.0)
    for elapsed_s in (0.004, 0.006, 0.020):
        station.advance(elapsed_s)
        moved = 0.5 * min(station.time_s, 0.01)
        context = system.GetMyContextFromRoot(station.simulator.get_context())
        np.testing.assert_allclose(desired.Eval(context)[:7], Q_HOME + moved * np.eye(7)[0])


def test_several_objects_stand_apart_by_default() -> None:
    station = Station(STATION, [make_box(name="left"), make_box(name="right")])
    station.advance(0.2)
    truth = Truth(station)
    assert {*truth.touching(0), *truth.touching(1)} == {"table"}
    assert np.linalg.norm(truth.X_WO(0)[:3, 3] - truth.X_WO(1)[:3, 3]) > 0.1


def test_diagram_has_the_documented_ports_and_can_be_drawn() -> None:
    station = Station(STATION)
    for name in ("arm", "gripper"):
        assert station.diagram.HasInputPort(name)
    for name in ("camera_top.depth_image", "camera_side.depth_image", "panda_state"):
        assert station.diagram.HasOutputPort(name)
    drawing = station.graphviz()
    assert all(word in drawing for word in ("digraph", "plant", "command", "camera_side"))


def test_missing_egl_names_the_packages_to_install() -> None:
    with pytest.raises(RenderingUnavailableError, match="apt-get install libegl1 libgl1-mesa-dri"):
        check_rendering("libEGL_that_does_not_exist.so.1")


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("friction", lambda: StationConfig(Layout(), friction=0.0)),
        ("time_step_s", lambda: StationConfig(Layout(), time_step_s=-0.1)),
        ("near_rigid_threshold", lambda: StationConfig(Layout(), near_rigid_threshold=-0.1)),
        ("arm_kp_nm_per_rad", lambda: StationConfig(Layout(), arm_kp_nm_per_rad=(1.0, 2.0))),
    ],
)
def test_config_names_the_impossible_value(name: str, make: Callable[[], StationConfig]) -> None:
    with pytest.raises(ValueError, match=f"{name} is .*expected"):
        make()


@pytest.mark.parametrize(
    ("q", "opening_m", "force_n"),
    [
        (np.zeros(6), 0.04, 10.0),
        (np.full(7, np.nan), 0.04, 10.0),
        (Q_HOME, 0.2, 10.0),
        (Q_HOME, 0.04, 0.0),
        (Q_HOME, 0.04, 41.0),
    ],
)
def test_impossible_commands_are_refused(q: Array, opening_m: float, force_n: float) -> None:
    station = Station(STATION)
    with pytest.raises(ValueError, match="expected"):
        station.command(q, np.zeros(7), opening_m, force_n)


@pytest.mark.parametrize("names", [("cup", "cup"), ("table",), ("panda_hand",)])
def test_object_names_must_be_free(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="name"):
        Station(STATION, [make_box(name=name) for name in names])
