"""What cameras show of a mug in the hand tells how it moved there."""

from functools import cache

import numpy as np
import pytest

from planning.handling.held_view import MAX_TURN_RAD, beside_robot, view_held
from split_drake.camera import DepthView
from split_drake.data.render import DepthRenderer
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import HANDLE
from split_drake.poses import (
    Array,
    invert_pose,
    make_pose,
    rotation_x,
    rotation_y,
    rotation_z,
    transform_points,
)
from split_drake.robot.kinematics import gripper_pose
from split_drake.scene import Scene
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from tests.helpers.planning import configuration
from tests.helpers.stations import STATION

LAYOUT = Layout()
LOWEST_Z_M = LAYOUT.workspace.lowest_z_m
MUG = load_mug("train_000")
X_WO = make_pose(rotation_z(0.6), (0.5, 0.0, 0.0))
WALL_M = 0.005
# The rim, pinched from straight above on the side away from the handle, which is towards x_O.
X_OG = make_pose(
    rotation_z(np.pi / 2.0) @ rotation_x(np.pi),
    (-0.5 * MUG.outer_diameter_m + WALL_M / 2.0, 0.0, MUG.body.mesh.bounds[1, 2] - 0.008),
)
Q = configuration((0.5, 0.0, 0.25))


@cache
def renderer() -> DepthRenderer:
    return DepthRenderer(MUG.body.mesh)


def views_of(X_WMug: Array) -> list[DepthView]:
    return [renderer().render(X_WMug, camera) for camera in LAYOUT.cameras]


@cache
def cloud_before() -> Array:
    """Return (N, 3) what was seen of the mug where it stood, in the gripper's frame there."""
    p_WPs = Scene.from_views(views_of(X_WO), LAYOUT.workspace).p_WPs
    return transform_points(invert_pose(X_WO @ X_OG), p_WPs)


def held(X_GE: Array) -> list[DepthView]:
    """Return views of the mug in the hand at Q, after it has moved there by X_GE (4, 4)."""
    return views_of(gripper_pose(Q) @ X_GE @ invert_pose(X_OG))


def errors_m(X_GEseen: Array, X_GE: Array) -> Array:
    """Return how far off a measurement has the handle's middle and the body's, (2,)."""
    p_OPs = np.stack([MUG.true_poses(HANDLE, np.eye(4))[0, :3, 3], MUG.body.p_OCom])
    p_EPs = transform_points(invert_pose(X_OG), p_OPs)
    off = transform_points(X_GEseen, p_EPs) - transform_points(X_GE, p_EPs)
    return np.asarray(np.linalg.norm(off, axis=1))


@pytest.mark.parametrize(
    ("turn_deg", "p_GE"),
    [(0.0, (0, 0, 0)), (8.0, (0.003, 0, -0.004)), (-20.0, (0, 0, 0.005)), (50.0, (0, 0, 0))],
)
def test_the_motion_in_the_hand_is_measured(turn_deg: float, p_GE: tuple[float, ...]) -> None:
    X_GE = make_pose(rotation_y(np.radians(turn_deg)), p_GE)
    view = view_held(held(X_GE), Q, WALL_M, cloud_before(), LOWEST_Z_M)
    assert view.rejected == ""
    assert errors_m(view.X_GE, X_GE).max() < 0.002
    assert view.turn_rad == pytest.approx(np.radians(abs(turn_deg)), abs=np.radians(3.0))


def test_the_search_starts_from_the_last_known_motion() -> None:
    known = make_pose(rotation_y(np.radians(65.0)))
    X_GE = make_pose(rotation_y(np.radians(70.0)))
    view = view_held(held(X_GE), Q, WALL_M, cloud_before(), LOWEST_Z_M, known)
    assert view.rejected == ""
    assert errors_m(view.X_GE, X_GE).max() < 0.003


def test_the_search_turns_about_the_pads_wherever_the_object_is() -> None:
    known = make_pose(rotation_z(np.radians(8.0)), (0.012, 0.0, -0.008))
    X_GE = make_pose(rotation_y(np.radians(48.0))) @ known
    view = view_held(held(X_GE), Q, WALL_M, cloud_before(), LOWEST_Z_M, known)
    assert view.rejected == ""
    assert errors_m(view.X_GE, X_GE).max() < 0.003


def test_an_empty_hand_is_no_measurement() -> None:
    expected = make_pose(p=(0.0, 0.0, 0.004))
    lying = views_of(X_WO)
    view = view_held(lying, Q, WALL_M, cloud_before(), LOWEST_Z_M, expected)
    assert "voxels were seen" in view.rejected and not view.elsewhere
    np.testing.assert_array_equal(view.X_GE, expected)


def test_another_object_in_the_hand_is_no_measurement() -> None:
    other = DepthRenderer(load_mug("train_003").body.mesh)
    X_WMug = gripper_pose(Q) @ make_pose(rotation_x(np.radians(90.0)), (0.02, 0.02, 0.06))
    views = [other.render(X_WMug, camera) for camera in LAYOUT.cameras]
    view = view_held(views, Q, WALL_M, cloud_before(), LOWEST_Z_M)
    assert view.elsewhere and "matches" in view.rejected and "expected 80%" in view.rejected
    np.testing.assert_array_equal(view.X_GE, np.eye(4))


def test_an_object_that_would_have_fallen_is_no_measurement() -> None:
    known = make_pose(rotation_y(MAX_TURN_RAD))
    X_GE = make_pose(rotation_y(MAX_TURN_RAD + 0.1))
    view = view_held(held(X_GE), Q, WALL_M, cloud_before(), LOWEST_Z_M, known)
    assert view.elsewhere and "seems to have moved by" in view.rejected
    np.testing.assert_array_equal(view.X_GE, known)


def test_points_of_the_robot_and_the_table_are_left_out() -> None:
    X_WMug = gripper_pose(Q) @ invert_pose(X_OG)
    shown = np.concatenate([view.points(LOWEST_Z_M) for view in views_of(X_WMug)])
    kept = beside_robot(views_of(X_WMug), Q, WALL_M, LOWEST_Z_M)
    assert 0 < len(kept) < len(shown)
    p_GPs = transform_points(invert_pose(gripper_pose(Q)), kept)
    beside_pads = np.all(np.abs(p_GPs) < (0.010, 0.015, 0.011), axis=1)
    assert not beside_pads.any()
    assert kept[:, 2].min() > LOWEST_Z_M
    assert len(beside_robot([], Q, WALL_M, LOWEST_Z_M)) == 0


def test_nothing_is_left_of_a_robot_above_the_workspace() -> None:
    station = Station(STATION)
    q = np.array([1.075, 0.858, -1.07, -2.638, -0.101, 3.66, 2.256])
    station.set_arm(q, 0.08)
    views = station.capture()
    in_sight = np.concatenate([view.points(LOWEST_Z_M) for view in views])
    assert LAYOUT.workspace.contains(in_sight).sum() > 1000, "the robot is in sight"
    left = beside_robot(views, q, 0.08, LOWEST_Z_M)
    assert not LAYOUT.workspace.contains(left).any()
