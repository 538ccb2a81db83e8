"""The table's own noise counts as table, and nothing else does."""

from dataclasses import replace

import numpy as np
import pytest

from split_drake.camera import DepthView
from split_drake.data.render import DepthRenderer
from split_drake.depth_noise import DEPTH_NOISE
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import Array, make_pose
from split_drake.scene import Scene, Workspace
from split_drake.sensing.depth_filter import DepthFilter
from split_drake.sensing.scene_report import measured_points, report_of
from split_drake.sensing.table_noise import (
    above_noise_of,
    above_table_noise,
    scene_above_noise,
    table_noise_m,
)
from split_drake.station.layout import Layout

LAYOUT = Layout()
WORKSPACE = LAYOUT.workspace


def table(std_m: float, offset_m: float = 0.0) -> Array:
    """Points of a table and, on a quarter of it, of a box of 6 cm."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform((0.3, -0.2), (0.7, 0.2), (40_000, 2)), np.zeros(40_000)])
    points[:, 2] = offset_m + rng.normal(0.0, std_m, len(points))
    points[(points[:, 0] < 0.5) & (points[:, 1] < 0.0), 2] += 0.06
    return points


@pytest.mark.parametrize("std_m", [0.0005, 0.002, 0.004])
def test_the_noise_of_the_table_is_measured_beside_what_stands_there(std_m: float) -> None:
    assert table_noise_m(WORKSPACE, table(std_m)) == pytest.approx(std_m, rel=0.1)


def test_a_table_that_lies_lower_is_no_noise() -> None:
    assert table_noise_m(WORKSPACE, table(0.0005, -0.008)) < 0.001


def test_cameras_that_disagree_about_the_table_are_no_noise(views: list[DepthView]) -> None:
    lower = replace(views[1], X_WC=make_pose(p=(0.0, 0.0, -0.006)) @ views[1].X_WC)
    assert above_table_noise(WORKSPACE, [views[0], lower]) is WORKSPACE


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_strays_are_no_noise(share: float) -> None:
    points, rng = table(0.0005), np.random.default_rng(1)
    strays = rng.random(len(points)) < share
    points[strays, 2] -= rng.uniform(0.0, 0.03, strays.sum())
    assert above_noise_of(WORKSPACE, points) is WORKSPACE


def test_no_noise_takes_more_than_two_centimetres() -> None:
    assert above_noise_of(WORKSPACE, table(0.009)).table_clearance_m == 0.02


def test_depth_in_whole_millimetres_is_no_noise() -> None:
    points = table(0.0004)
    points[:, 2] = np.round(points[:, 2] + 0.0003, 3)
    assert above_noise_of(WORKSPACE, points) is WORKSPACE


def test_where_no_table_is_seen_the_workspace_stays() -> None:
    for points in (np.empty((0, 3)), table(0.004)[:300], table(0.004, 0.1)):
        assert above_noise_of(WORKSPACE, points) is WORKSPACE
    assert above_noise_of(WORKSPACE, table(0.0009)) is WORKSPACE


def test_a_noisy_table_raises_the_clearance() -> None:
    raised = above_noise_of(WORKSPACE, table(0.004))
    assert raised.table_clearance_m == pytest.approx(0.018, rel=0.1)
    points = table(0.004)
    assert (WORKSPACE.contains(points) & (points[:, 2] < 0.03)).sum() > 1000
    assert (raised.contains(points) & (points[:, 2] < 0.03)).sum() < 20


def test_no_clearance_leaves_nothing_of_a_small_workspace() -> None:
    small = Workspace(edge_m=0.08, depth_below_m=0.06)
    raised = above_noise_of(small, table(0.0069))
    assert raised.table_clearance_m == pytest.approx(0.01)
    high = Workspace(edge_m=0.08, depth_below_m=0.06, table_clearance_m=0.012)
    assert above_noise_of(high, table(0.0069)).table_clearance_m == 0.012


@pytest.fixture(scope="module")
def views() -> list[DepthView]:
    renderer = DepthRenderer(load_mug("train_003").body.mesh)
    return [renderer.render(make_pose(p=(0.5, 0.0, 0.0)), each) for each in LAYOUT.cameras]


def test_a_bad_camera_shows_the_mug_and_no_table(views: list[DepthView]) -> None:
    rng = np.random.default_rng(1)
    noise = DEPTH_NOISE["high"]
    assert noise is not None
    noisy = [DepthFilter().seen(noise.seen(view, rng)) for view in views]
    true = Scene.from_views(views, WORKSPACE)
    lower, upper = true.p_WPs.min(axis=0) - 0.02, true.p_WPs.max(axis=0) + 0.02
    plain = Scene.from_views(noisy, WORKSPACE)
    assert not ((plain.p_WPs > lower) & (plain.p_WPs < upper)).all()
    scene = scene_above_noise(noisy, WORKSPACE)
    assert scene.workspace == WORKSPACE
    assert len(scene.p_WPs) > 0.7 * len(true.p_WPs)
    assert ((scene.p_WPs > lower) & (scene.p_WPs < upper)).all()
    counted = above_table_noise(WORKSPACE, noisy)
    (warning,) = report_of(scene, measured_points(noisy), counted).warnings
    assert "counts as table, in place of 4 mm" in warning


def test_what_a_good_camera_shows_stays_as_it_is(views: list[DepthView]) -> None:
    assert above_table_noise(WORKSPACE, views) is WORKSPACE
    scene = scene_above_noise(views, WORKSPACE)
    np.testing.assert_array_equal(scene.p_WPs, Scene.from_views(views, WORKSPACE).p_WPs)
