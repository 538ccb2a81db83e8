"""Pegs through handles."""

import numpy as np
import pytest
import shapely
import trimesh

from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.peg_test import PEG_RADIUS_M, PEG_REACH_M, PegTest
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

X_WO = make_pose(rotation_z(0.7) @ rotation_x(1.2), (0.5, 0.03, 0.06))


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("test_002")


@pytest.fixture(scope="module")
def peg(mug: MugShape) -> PegTest:
    return PegTest(mug)


def clearance_m(mug: MugShape) -> float:
    """Return the room between the handle frame's origin and the opening's outline."""
    x, z = mug.X_OH[[0, 2], 3]
    outline = shapely.LinearRing(mug.opening_OPs[:, [0, 2]])
    return float(outline.distance(shapely.Point(x, z)))


def test_true_handle_poses_are_clear_whichever_way_they_face(mug: MugShape, peg: PegTest) -> None:
    X_WHs = mug.true_poses(HANDLE, X_WO)
    turned = X_WHs @ make_pose(np.stack([rotation_y(1.0), rotation_y(-2.0)]))
    assert peg.clear(X_WO, np.concatenate([X_WHs, turned])).all()


@pytest.mark.parametrize("direction", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_a_peg_moved_by_more_than_the_room_around_it_hits_the_mug(
    direction: tuple[float, float], mug: MugShape, peg: PegTest
) -> None:
    x, z = direction
    outline = shapely.LinearRing(mug.opening_OPs[:, [0, 2]])
    start = shapely.Point(mug.X_OH[[0, 2], 3])
    way = shapely.LineString([start, shapely.Point(start.x + x, start.y + z)])
    room_m = start.distance(way.intersection(outline))
    X_WHs = X_WO @ mug.X_OH @ make_pose(p=room_m * np.array([[x, 0.0, z]]))
    assert not peg.clear(X_WO, X_WHs).any()


def test_a_peg_may_move_within_the_room_around_it(mug: MugShape, peg: PegTest) -> None:
    # The handle's bars are rounded: the outline in the plane y = 0 is where they are the thickest.
    room_m = clearance_m(mug) - PEG_RADIUS_M - 0.001
    assert room_m > 0.001
    angles = np.linspace(0.0, 2.0 * np.pi, 12)
    shifts = np.column_stack([np.cos(angles), np.zeros(12), np.sin(angles)])
    X_OHs = mug.X_OH @ make_pose(p=room_m * shifts)
    assert peg._crosses(X_OHs).all()
    # Pegs that hug the body's curved wall may touch it further out.
    assert peg._misses(X_OHs).mean() > 0.7


def test_a_peg_beside_the_mug_is_not_in_its_handle(mug: MugShape, peg: PegTest) -> None:
    beside = make_pose(p=[(0.1, 0.0, 0.0), (0.0, 0.0, 0.3), (0.0, 0.2, 0.0)])
    assert not peg.clear(X_WO, X_WO @ mug.X_OH @ beside).any()


def test_a_peg_that_ends_before_the_opening_is_not_through_it(mug: MugShape, peg: PegTest) -> None:
    along = make_pose(p=[(0.0, PEG_REACH_M - 0.001, 0.0), (0.0, PEG_REACH_M + 0.001, 0.0)])
    assert peg.clear(X_WO, X_WO @ mug.X_OH @ along).tolist() == [True, False]


def test_lines_of_rays_agree_with_points_of_the_surface(mug: MugShape, peg: PegTest) -> None:
    rng = np.random.default_rng(0)
    turns = np.stack([rotation_x(a) @ rotation_z(b) for a, b in rng.normal(0.0, 0.3, (200, 2))])
    X_OHs = mug.X_OH @ make_pose(turns, rng.normal(0.0, 0.006, (200, 3)))
    p_OPs, _ = trimesh.sample.sample_surface(mug.body.mesh, 50_000, seed=0)
    distances = np.array([distance_from_axis_m(X_OH, p_OPs) for X_OH in X_OHs])
    decided = np.abs(distances - PEG_RADIUS_M) > 0.0003
    misses = peg._misses(X_OHs)
    assert decided.sum() > 150
    assert 20 < misses.sum() < 180
    assert (misses == (distances > PEG_RADIUS_M))[decided].all()


def distance_from_axis_m(X_OH: Array, p_OPs: Array) -> float:
    """Return how near points (N, 3) beside the peg come to its axis."""
    x, y, z = transform_points(invert_pose(X_OH), p_OPs).T
    return float(np.hypot(x, z)[np.abs(y) < PEG_REACH_M].min())
