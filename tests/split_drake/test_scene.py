"""Depth views and scenes."""

import numpy as np
import pytest

from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.scene import (
    EmptySceneError,
    Scene,
    Voxels,
    Workspace,
    farthest_points,
    occupancy_grid,
)
from split_drake.station.layout import Layout

TOP, SIDE = Layout().cameras
WORKSPACE = Layout().workspace
BOX_TOP_M = 0.102


def box_view() -> DepthView:
    """The top camera above a table with a box of 6 cm by 6 cm and 10 cm height at its centre."""
    depth = np.full((480, 640), 0.6, dtype=np.float32)
    half = round(0.03 * TOP.intrinsics.fx / (0.6 - BOX_TOP_M))
    depth[240 - half : 240 + half, 320 - half : 320 + half] = 0.6 - BOX_TOP_M
    return DepthView(depth, TOP.intrinsics, TOP.X_WC)


def test_points_are_where_they_were_seen() -> None:
    points = Scene.from_views([box_view()], WORKSPACE).p_WPs
    np.testing.assert_allclose(points[:, 2], BOX_TOP_M, atol=1e-5)
    np.testing.assert_allclose(points[:, :2].mean(axis=0), (0.5, 0.0), atol=1e-3)
    np.testing.assert_allclose(np.ptp(points[:, :2], axis=0), 0.06, atol=2e-3)


def test_pixels_are_unprojected_as_opencv_does() -> None:
    depth = np.zeros((4, 5), dtype=np.float32)
    depth[3, 1] = 2.0
    view = DepthView(depth, Intrinsics(5, 4, fx=2.0, fy=4.0, cx=2.0, cy=1.5), np.eye(4))
    np.testing.assert_allclose(view.points(), [[2.0 * (1 - 2) / 2, 2.0 * (3 - 1.5) / 4, 2.0]])


def test_cameras_see_the_workspace_centre_in_their_middle() -> None:
    layout = Layout()
    for camera in layout.cameras:
        p_CCenter = np.linalg.inv(camera.X_WC) @ (*layout.workspace.p_WCenter, 1.0)
        np.testing.assert_allclose(p_CCenter[:3], (0.0, 0.0, 0.6), atol=1e-12)


def test_the_table_is_left_out_and_the_grid_matches_the_points() -> None:
    scene = Scene.from_views([box_view()], WORKSPACE)
    grid = scene.grid()
    assert grid.shape == (64, 64, 64)
    assert grid is scene.grid()
    z_index = int((BOX_TOP_M + 0.05) / 0.3 * 64)
    assert set(np.nonzero(grid)[2]) == {z_index}
    assert 150 < grid.sum() < 200  # a square of 6 cm in voxels of 4.7 mm


def test_sampling_spreads_points() -> None:
    points = np.random.default_rng(0).uniform(size=(5000, 3))
    sampled = farthest_points(points, 100)
    distances = np.linalg.norm(sampled[:, None] - sampled[None], axis=-1) + 9.0 * np.eye(100)
    random_distances = np.linalg.norm(points[:100, None] - points[None, :100], axis=-1)
    assert distances.min() > 5.0 * (random_distances + 9.0 * np.eye(100)).min()


def test_few_points_are_repeated() -> None:
    sampled = farthest_points(np.arange(9.0).reshape(3, 3), 7)
    assert sampled.shape == (7, 3)
    assert len(np.unique(sampled, axis=0)) == 3


def test_points_outside_the_grid_are_ignored() -> None:
    workspace = Workspace()
    corner = workspace.p_WV
    points = np.array([corner + 1e-6, corner - 1e-3, corner + 0.3 + 1e-3])
    grid = occupancy_grid(points, workspace, 64)
    assert grid.sum() == 1
    assert grid[0, 0, 0]


def test_noise_is_off_by_default_seeded_and_only_on_the_sampled_points() -> None:
    clean = Scene.from_views([box_view()], WORKSPACE)
    assert np.isin(clean.p_WSs[:, 0], clean.p_WPs[:, 0]).all()
    noisy = clean.with_noise(0.005, np.random.default_rng(3))
    again = clean.with_noise(0.005, np.random.default_rng(3))
    np.testing.assert_array_equal(noisy.p_WSs, again.p_WSs)
    np.testing.assert_array_equal(noisy.p_WPs, clean.p_WPs)
    assert np.std(noisy.p_WSs - clean.p_WSs) == pytest.approx(0.005, rel=0.05)
    with pytest.raises(ValueError, match="noise_m is -1"):
        clean.with_noise(-1.0, np.random.default_rng(0))


def view_of(depth: np.ndarray, X_WC: np.ndarray = TOP.X_WC) -> DepthView:
    return DepthView(depth, TOP.intrinsics, X_WC)


def test_bad_depth_is_named() -> None:
    good = np.full((480, 640), 0.6)
    with pytest.raises(ValueError, match="looks like millimetres"):
        view_of(1000.0 * good)
    with pytest.raises(ValueError, match=r"shape \(640, 480\)"):
        view_of(good.T)
    with pytest.raises(ValueError, match="expected metres >= 0"):
        view_of(-good)


@pytest.mark.parametrize("nothing", [0.0, np.inf, np.nan, 65.535])
def test_what_a_camera_did_not_see_is_marked_by_zero(nothing: float) -> None:
    depth = np.full((480, 640), nothing)
    depth[100:102, 200:210] = 0.55
    seen = view_of(depth)
    assert seen.depth_m.dtype == np.float32
    assert np.count_nonzero(seen.depth_m) == 20
    assert len(seen.points()) == 20


def test_masked_pixels_are_not_seen() -> None:
    view = view_of(np.full((480, 640), 0.6))
    hidden = np.zeros((480, 640), dtype=bool)
    hidden[:240] = True
    assert len(view.masked(hidden).points()) == 240 * 640
    assert not view.masked(hidden).depth_m[:240].any()
    with pytest.raises(ValueError, match=r"mask has shape \(480,\) and type bool"):
        view.masked(hidden[:, 0])
    with pytest.raises(ValueError, match="type int64; expected"):
        view.masked(hidden.astype(int))


def test_a_rotation_of_four_digits_is_made_orthonormal_and_told() -> None:
    rounded = np.round(SIDE.X_WC, 3)
    with pytest.warns(UserWarning, match="rotation of X_WC is not orthonormal; its entries were"):
        view = view_of(np.full((480, 640), 0.6), rounded)
    R = view.X_WC[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R, SIDE.X_WC[:3, :3], atol=1e-3)
    with pytest.raises(ValueError, match=r"R R\^T - I\| reaches 0\.01"):
        view_of(np.full((480, 640), 0.6), np.round(SIDE.X_WC, 1) * [1.0, 1.01, 1.0, 1.0])


def test_a_camera_matrix_gives_its_numbers() -> None:
    K = [[500.0, 0.0, 310.0], [0.0, 505.0, 250.0], [0.0, 0.0, 1.0]]
    assert Intrinsics.from_matrix(K, (640, 480)) == Intrinsics(640, 480, 500, 505, 310, 250)
    for wrong, said in (
        (np.eye(4), "expected a \\(3, 3\\) camera matrix"),
        (np.full((3, 3), np.nan), "expected a \\(3, 3\\) camera matrix"),
        (np.transpose(K), "expected \\[\\[fx, 0, cx\\]"),
        (2.0 * np.array(K), "expected \\[\\[fx, 0, cx\\]"),
    ):
        with pytest.raises(ValueError, match=said):
            Intrinsics.from_matrix(wrong, (640, 480))


def test_a_cloud_is_cropped_and_points_not_seen_are_left_out() -> None:
    inside = np.array([[0.5, 0.0, 0.05], [0.52, 0.01, 0.08], [0.45, -0.1, 0.02]])
    table, far = [0.5, 0.0, 0.001], [0.9, 0.0, 0.05]
    unseen = [[np.nan] * 3, [0.5, np.inf, 0.1]]
    scene = Scene.from_points([*inside.tolist(), table, far, *unseen], Workspace())
    np.testing.assert_array_equal(scene.p_WPs, inside)
    assert scene.p_WSs.shape == (Scene.SAMPLED_POINTS, 3)
    assert scene.views == ()
    with pytest.raises(EmptySceneError, match="none of the 1 points seen above the table"):
        Scene.from_points([table, far], Workspace())
    with pytest.raises(ValueError, match=r"cloud has shape \(3, 2\); expected \(N, 3\)"):
        Scene.from_points(inside[:, :2], Workspace())


def test_a_scene_of_points_outside_its_workspace_is_refused() -> None:
    cloud = np.array([[0.5, 0.0, 0.05], [0.9, 0.0, 0.05], [0.5, 0.0, -0.01]])
    with pytest.raises(
        ValueError, match=r"2 of 3 points p_WPs are outside .*Scene.from_points crops"
    ):
        Scene(cloud, cloud[:1], Workspace())
    with pytest.raises(ValueError, match="p_WSs holds NaN"):
        Scene(cloud[:1], np.full((5, 3), np.nan), Workspace())
    with pytest.raises(ValueError, match=r"p_WPs has shape \(0, 3\); expected"):
        Scene(np.empty((0, 3)), cloud, Workspace())


def test_bad_camera_poses_are_named() -> None:
    good = np.full((480, 640), 0.6)
    with pytest.raises(ValueError, match=r"X_WC.*orthonormal|rotation of X_WC"):
        view_of(good, np.diag([1.0, 1.0, 0.5, 1.0]))
    with pytest.raises(ValueError, match=r"X_WC has shape \(3, 4\)"):
        view_of(good, np.eye(4)[:3])


def test_bad_intrinsics_and_views_are_named() -> None:
    with pytest.raises(ValueError, match="fx=0"):
        Intrinsics(640, 480, 0.0, 540.0, 320.0, 240.0)
    with pytest.raises(ValueError, match="parallel"):
        look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


def test_an_empty_cloud_is_an_error() -> None:
    with pytest.raises(EmptySceneError, match="none of the 0 points seen above the table"):
        Scene.from_views([view_of(np.full((480, 640), 0.6))], WORKSPACE)
    with pytest.raises(ValueError, match="no depth views"):
        Scene.from_views([], WORKSPACE)


def test_voxels_hold_the_points_that_lie_in_them_in_order() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.05, 0.05, (3000, 3)) * (1.0, 1.0, 0.1)
    voxels = Voxels.of(points, 0.01)
    cells, of_point, counts = np.unique(
        np.floor(points / 0.01).astype(int), axis=0, return_inverse=True, return_counts=True
    )
    np.testing.assert_array_equal(voxels.of_point, of_point.reshape(-1))
    np.testing.assert_array_equal(voxels.counts, counts)
    for voxel in range(0, len(cells), 7):
        mean = points[voxels.of_point == voxel].mean(axis=0)
        np.testing.assert_allclose(voxels.middles[voxel], mean, atol=1e-12)
    assert Voxels.of(np.empty((0, 3)), 0.01).middles.shape == (0, 3)
