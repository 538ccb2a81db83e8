"""Scenes: drawn as trials start, or varied for training within what the configuration says."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from split_drake.data.object_scenes import (
    NO_FEATURE,
    VISIBLE_POINTS,
    ObjectScene,
    ObjectScenes,
    feature_visible,
)
from split_drake.data.placements import PlacementConfig, Placements
from split_drake.data.randomization import DomainRandomization, depth_edges
from split_drake.data.render import DepthRenderer, RayImage
from split_drake.data.rests import Rests
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.task_object import TaskObject
from split_drake.poses import invert_pose, make_pose, rotation_error_rad, transform_points
from split_drake.scene import Scene
from split_drake.station.layout import CameraPlacement, Layout
from split_drake.truth.starts import SPREAD_M
from tests.helpers.data import make_rests

LAYOUT = Layout()
NOTHING_VARIES = DomainRandomization(
    camera_turn_rad=0.0,
    camera_shift_m=0.0,
    calibration_turn_rad=0.0,
    calibration_shift_m=0.0,
    table_height_m=0.0,
    grazing_loss=0.0,
    edge_loss=0.0,
    single_view_share=0.0,
)


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("train_002")


@pytest.fixture(scope="module")
def placements(mug: MugShape) -> Placements:
    return Placements(mug.body, make_rests(mug), LAYOUT.workspace)


def scenes(
    subject: TaskObject, randomization: DomainRandomization | None, count: int = 1, seed: int = 0
) -> list[ObjectScene]:
    rng = np.random.default_rng(seed)
    drawn = ObjectScenes(subject, make_rests(subject), LAYOUT, randomization)
    return [drawn.draw(rng) for _ in range(count)]


def distances_to_mug_m(mug: MugShape, scene: ObjectScene) -> np.ndarray:
    """Return how far the sampled points lie from the nearest of many on the mug's surface."""
    p_OSurface, _ = trimesh.sample.sample_surface(mug.body.mesh, 100_000, seed=0)
    p_OSs = transform_points(invert_pose(scene.X_WO), scene.p_WSs)
    return np.asarray(cKDTree(p_OSurface).query(p_OSs)[0])


def test_starts_are_rests_turned_and_moved(placements: Placements, mug: MugShape) -> None:
    rng, rests = np.random.default_rng(0), make_rests(mug)
    found = set()
    for _ in range(40):
        X_WO = placements.draw_start(rng)
        # A rest and what was drawn differ by a yaw and a shift along the table.
        X_WTs = X_WO @ invert_pose(rests.X_TOs)
        upright = np.flatnonzero(np.abs(X_WTs[:, 2, 2] - 1.0) < 1e-9)
        assert len(upright) == 1
        p_WT = X_WTs[upright[0], :3, 3]
        assert np.abs(p_WT[:2] - (0.5, 0.0)).max() <= SPREAD_M
        assert abs(p_WT[2]) < 1e-12
        found.add(int(upright[0]))
    assert found == {0, 1, 2}


def test_starts_beside_the_workspace_are_drawn_again(mug: MugShape) -> None:
    rests = make_rests(mug)
    beside = rests.X_TOs[:1] + make_pose(p=(0.3, 0.0, 0.0)) - np.eye(4)
    both = Placements(mug.body, Rests(np.concatenate([rests.X_TOs, beside]), 4), LAYOUT.workspace)
    rng = np.random.default_rng(0)
    for _ in range(40):
        p_WPs = transform_points(both.draw_start(rng), mug.body.mesh.vertices)
        assert np.abs(p_WPs[:, :2] - (0.5, 0.0)).max() <= LAYOUT.workspace.edge_m / 2.0
    never = Placements(mug.body, Rests(beside, 1), LAYOUT.workspace)
    with pytest.raises(ValueError, match=r"partly outside the workspace of 0\.3 m in all of 200"):
        never.draw_start(rng)


def test_varied_poses_stand_on_the_table_in_the_workspace(
    placements: Placements, mug: MugShape
) -> None:
    rng, config = np.random.default_rng(1), PlacementConfig(upright_share=0.5)
    room_m = LAYOUT.workspace.edge_m / 2.0 - config.margin_m
    cosines = []
    for _ in range(60):
        X_WO = placements.draw_varied(config, 0.003, rng)
        p_WPs = transform_points(X_WO, mug.body.mesh.vertices)
        assert p_WPs[:, 2].min() == pytest.approx(0.003, abs=1e-9)
        assert np.abs(p_WPs[:, :2] - (0.5, 0.0)).max() <= room_m + 1e-9
        middle = (p_WPs.min(axis=0) + p_WPs.max(axis=0))[:2] / 2.0
        assert np.abs(middle - (0.5, 0.0)).max() <= config.offset_m + 1e-9
        cosines.append(X_WO[2, 2])
    upright = np.array(cosines) > 0.99
    assert 0.4 < upright.mean() < 0.9  # Half, and a third of the rests.
    assert not np.allclose(np.array(cosines)[upright], 1.0, atol=1e-6)


def test_objects_that_do_not_fit_and_wrong_shares_are_named(mug: MugShape) -> None:
    small = replace(LAYOUT.workspace, edge_m=0.06)
    tight = Placements(mug.body, make_rests(mug), small)
    with pytest.raises(ValueError, match=r"does not fit the workspace of 0\.06 m"):
        tight.draw_varied(PlacementConfig(), 0.0, np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"upright_share is 1\.2; expected 0 to 1"):
        PlacementConfig(upright_share=1.2)
    with pytest.raises(ValueError, match=r"edge_loss is 2\.0; expected 0 to 1"):
        DomainRandomization(edge_loss=2.0)
    with pytest.raises(ValueError, match=r"table_height_m is -0\.1; expected at least 0"):
        DomainRandomization(table_height_m=-0.1)


@pytest.mark.parametrize("randomization", [None, NOTHING_VARIES], ids=["start", "nothing varies"])
def test_nominal_scenes_are_what_the_station_s_cameras_see(
    mug: MugShape, randomization: DomainRandomization | None
) -> None:
    (scene,) = scenes(mug, randomization)
    renderer = DepthRenderer(mug.body.mesh)
    whole = Scene.from_views(
        [renderer.render(scene.X_WO, camera) for camera in LAYOUT.cameras], LAYOUT.workspace
    )
    assert scene.views == 2
    assert scene.table_z_m == 0.0
    assert np.allclose(scene.p_WPs, whole.p_WPs, atol=1e-6)
    assert np.allclose(scene.p_WSs, whole.p_WSs, atol=1e-6)


def test_scenes_follow_the_seed(mug: MugShape) -> None:
    first, again, other = (scenes(mug, DomainRandomization(), seed=seed)[0] for seed in (3, 3, 4))
    assert np.array_equal(first.p_WSs, again.p_WSs)
    assert not np.array_equal(first.p_WSs, other.p_WSs)


def test_known_camera_poses_leave_points_on_the_mug_and_wrong_ones_do_not(mug: MugShape) -> None:
    moved = replace(NOTHING_VARIES, camera_turn_rad=0.05, camera_shift_m=0.02)
    wrong = replace(NOTHING_VARIES, calibration_shift_m=0.01)
    (seen_elsewhere,) = scenes(mug, moved)
    (displaced,) = scenes(mug, wrong)
    assert distances_to_mug_m(mug, seen_elsewhere).max() < 2.5e-3
    assert np.median(distances_to_mug_m(mug, seen_elsewhere)) < 5e-4
    assert np.median(distances_to_mug_m(mug, displaced)) > 1.5e-3


def test_a_table_above_the_clearance_appears(mug: MugShape) -> None:
    clearance_m = LAYOUT.workspace.table_clearance_m
    drawn = scenes(mug, replace(NOTHING_VARIES, table_height_m=0.006), count=12)
    heights = [scene.table_z_m for scene in drawn]
    assert min(heights) < clearance_m < max(heights)
    for scene in drawn:
        on_table = np.abs(scene.p_WSs[:, 2] - scene.table_z_m) < 1e-4
        spread_m = np.ptp(scene.p_WSs[on_table, 0]) if on_table.any() else 0.0
        assert (spread_m > 0.25) == (scene.table_z_m > clearance_m)


def test_single_views_and_hidden_handles(mug: MugShape) -> None:
    alone = replace(NOTHING_VARIES, single_view_share=1.0, hidden_share=0.0)
    shown = scenes(mug, alone, count=25)
    hidden = scenes(mug, replace(alone, hidden_share=1.0), count=25)
    assert {scene.views for scene in (*shown, *hidden)} == {1}
    counts = [np.median([s.feature_points for s in drawn]) for drawn in (shown, hidden)]
    assert counts[1] < counts[0] / 2.0


def test_what_has_no_feature_is_varied_as_well_and_counts_as_visible(mug: MugShape) -> None:
    hidden = replace(NOTHING_VARIES, single_view_share=1.0, hidden_share=1.0)
    (scene,) = scenes(TaskObject(body=mug.body), hidden)
    assert scene.feature_points == NO_FEATURE
    points = [NO_FEATURE, 0, VISIBLE_POINTS - 1, VISIBLE_POINTS]
    assert feature_visible(points).tolist() == [True, False, False, True]


def slope(cosine: float, depth_m: np.ndarray) -> RayImage:
    intrinsics = LAYOUT.cameras[0].intrinsics
    return RayImage(depth_m, np.full(depth_m.shape, cosine, np.float32), intrinsics)


def test_pixels_are_lost_where_surfaces_graze_and_depth_jumps() -> None:
    random = replace(DomainRandomization(), grazing_loss=1.0, edge_loss=1.0)
    flat = np.full((60, 80), 0.5, np.float32)
    step = flat.copy()
    step[:, 40:] += 0.02
    rng = np.random.default_rng(0)
    lost = [random.missing(slope(0.05, flat), rng).mean() for _ in range(20)]
    assert min(lost) < 0.3 < 0.7 < max(lost)
    assert not random.missing(slope(0.9, flat), rng).any()
    at_the_step = np.any([random.missing(slope(0.9, step), rng) for _ in range(20)], axis=0)
    assert set(np.flatnonzero(at_the_step.any(axis=0))) == {39, 40}


def test_edges_lie_on_both_sides_of_a_step() -> None:
    depth = np.zeros((6, 7), np.float32)
    depth[2:4, 3:5] = 1.0
    edges = depth_edges(depth, 0.5)
    expected = np.zeros((6, 7), bool)
    expected[1:5, 3:5] = True
    expected[2:4, 2:6] = True
    assert np.array_equal(edges, expected)


def test_cameras_stand_about_where_they_nominally_do() -> None:
    random, rng = DomainRandomization(single_view_share=0.5), np.random.default_rng(0)
    drawn = [random.draw_cameras(LAYOUT.cameras, rng) for _ in range(200)]
    assert {len(cameras) for cameras in drawn} == {1, 2}
    nominal = {camera.name: camera for camera in LAYOUT.cameras}
    alone = {cameras[0].name for cameras in drawn if len(cameras) == 1}
    assert alone == set(nominal)

    def moved_m(camera: CameraPlacement) -> float:
        return float(np.linalg.norm((camera.X_WC - nominal[camera.name].X_WC)[:3, 3]))

    cameras = [camera for both in drawn for camera in both]
    turns = [rotation_error_rad(c.X_WC[:3, :3], nominal[c.name].X_WC[:3, :3]) for c in cameras]
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(0.017 * np.sqrt(3.0), rel=0.15)
    shifts = [moved_m(camera) for camera in cameras]
    assert np.sqrt(np.mean(np.square(shifts))) == pytest.approx(0.005 * np.sqrt(3.0), rel=0.15)
