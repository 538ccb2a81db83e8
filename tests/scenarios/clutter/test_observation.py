"""What the detectors of clutter removal see."""

from dataclasses import replace

import numpy as np
import pytest

from scenarios.clutter.observation import GAUSSIAN_M, dex_noise, observe, side_camera
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.camera import DepthView
from split_drake.poses import transform_points
from split_drake.scene import EmptySceneError, Scene, Workspace
from split_drake.table_fit import table_depth

WORKSPACE = Workspace()
CAMERA = side_camera(WORKSPACE)


def view_of(depth_m: float) -> DepthView:
    image = np.full((480, 640), depth_m, dtype=np.float32)
    return DepthView(image, CAMERA.intrinsics, CAMERA.X_WC)


def test_the_camera_looks_at_the_middle_from_the_side() -> None:
    target = transform_points(CAMERA.X_WC, np.array([[0.0, 0.0, 0.6]]))[0]
    np.testing.assert_allclose(target, (0.5, 0.0, 0.05), atol=1e-9)
    assert np.degrees(np.arccos(-CAMERA.X_WC[2, 2])) == pytest.approx(60.0)


def test_dex_noise_has_the_spread_that_it_is_said_to_have() -> None:
    flat = np.full((120, 160), 0.6, dtype=np.float32)
    images = [dex_noise(flat, np.random.default_rng(seed)) for seed in range(400)]
    means = np.array([image.mean() for image in images])
    assert means.mean() == pytest.approx(0.6, abs=0.004)
    assert means.std() == pytest.approx(0.019, rel=0.15)
    smooth = np.array([image.std() for image in images])
    assert 0.4 < (smooth > 0.001).mean() < 0.6
    assert np.median(smooth[smooth > 0.001]) == pytest.approx(0.005 * 2 / 3, rel=0.15)


def test_what_was_not_measured_stays_so() -> None:
    image = np.full((8, 8), 0.5, dtype=np.float32)
    image[2, 3] = 0.0
    for seed in range(4):
        assert np.argwhere(dex_noise(image, np.random.default_rng(seed)) == 0.0).tolist() == [
            [2, 3]
        ]


def test_gaussian_noise_moves_the_sampled_points_and_shows_in_the_view() -> None:
    rng = np.random.default_rng(0)
    image = view_of(0.6)
    image.depth_m[:10] = 0.0
    clean = observe(image, WORKSPACE, "none", rng)
    noisy = observe(image, WORKSPACE, "gaussian", rng)
    shown = noisy.views[0].depth_m
    assert (shown[:10] == 0.0).all()
    assert (shown[10:] - 0.6).std() == pytest.approx(GAUSSIAN_M, rel=0.02)
    again = observe(image, WORKSPACE, "none", rng).with_noise(GAUSSIAN_M, np.random.default_rng(0))
    np.testing.assert_array_equal(noisy.p_WSs, again.p_WSs)
    assert isinstance(clean, Scene)
    np.testing.assert_array_equal(noisy.p_WPs, clean.p_WPs)
    assert (noisy.p_WSs - clean.p_WSs).std() == pytest.approx(GAUSSIAN_M, rel=0.1)


def test_views_of_nothing_are_empty() -> None:
    with pytest.raises(EmptySceneError):
        observe(view_of(3.0), WORKSPACE, "none", np.random.default_rng(0))


def test_a_fitted_table_is_where_it_is() -> None:
    table = view_of(0.6)
    depth_m = table_depth(table, WORKSPACE.p_WCenter[2]).astype(np.float32)
    true = replace(table, depth_m=depth_m)
    true.depth_m[200:280, 280:360] -= np.float32(0.08)
    rng = np.random.default_rng(3)
    fitted = observe(true, WORKSPACE, "dex", rng, fit_table=True)
    alone = observe(true, WORKSPACE, "none", rng)
    assert len(fitted.p_WPs) == pytest.approx(len(alone.p_WPs), rel=0.1)
    np.testing.assert_allclose(fitted.p_WPs.mean(axis=0), alone.p_WPs.mean(axis=0), atol=0.004)


def test_images_still_show_the_table_that_the_cloud_does_without() -> None:
    table = view_of(0.6)
    depth_m = table_depth(table, WORKSPACE.p_WCenter[2]).astype(np.float32)
    true = replace(table, depth_m=depth_m)
    true.depth_m[200:280, 280:360] -= np.float32(0.08)
    fitted = observe(true, WORKSPACE, "dex", np.random.default_rng(3), fit_table=True)
    field = fused_tsdf(fitted.views, WORKSPACE)
    of_truth = fused_tsdf([true], WORKSPACE)
    assert (field > 0.0).sum() == pytest.approx((of_truth > 0.0).sum(), rel=0.1)
