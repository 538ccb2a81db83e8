"""Smoothing of depth images, on planes and steps made up for the purpose."""

import numpy as np
import pytest

from split_drake.bad_input import BadInputError
from split_drake.camera import DepthView, Intrinsics
from split_drake.depth_noise import DEPTH_NOISE, DepthNoiseLevel
from split_drake.poses import Array, make_pose
from split_drake.sensing.depth_filter import DepthFilter

NEAR_M, FAR_M = 0.5, 0.6


def view_of(depth_m: Array) -> DepthView:
    height, width = depth_m.shape
    intrinsics = Intrinsics.centered(width, height, focal_px=540.0)
    return DepthView(depth_m.astype(np.float32), intrinsics, make_pose())


def step() -> Array:
    depth = np.full((40, 60), FAR_M)
    depth[:, 30:] = NEAR_M
    return depth


def test_a_plane_stays_where_it_is_and_gets_smoother() -> None:
    rng = np.random.default_rng(0)
    noisy = FAR_M + rng.normal(0.0, 0.002, (60, 80))
    smooth = DepthFilter().seen(view_of(noisy)).depth_m
    smooth = smooth[5:-5, 5:-5]
    assert np.all(smooth > 0.0)
    assert smooth.std() < 0.25 * noisy.std()
    assert smooth.mean() == pytest.approx(FAR_M, abs=1e-4)


def test_a_tilted_plane_stays_where_it_is() -> None:
    tilted = np.tile(0.5 + 0.002 * np.arange(60), (40, 1))
    smooth = DepthFilter().seen(view_of(tilted)).depth_m
    np.testing.assert_allclose(smooth[5:-5, 5:-5], tilted[5:-5, 5:-5], atol=1e-6)


def test_a_step_stays_as_sharp_as_it_is() -> None:
    np.testing.assert_allclose(DepthFilter().seen(view_of(step())).depth_m, step(), atol=1e-6)


def test_pixels_that_fly_and_pixels_that_saw_nothing_show_nothing() -> None:
    depth = step()
    depth[10, 30], depth[20, 10], depth[25, 45] = 0.55, 0.0, np.nan
    smooth = DepthFilter().seen(view_of(depth)).depth_m
    assert smooth[10, 30] == smooth[20, 10] == smooth[25, 45] == 0.0
    depth[10, 30], depth[20, 10], depth[25, 45] = NEAR_M, FAR_M, NEAR_M
    seen = smooth > 0.0
    assert np.count_nonzero(~seen) == 3
    np.testing.assert_allclose(smooth[seen], depth[seen], atol=1e-6)


@pytest.mark.parametrize(
    ("level", "left"), [("low", 0.0), ("middle", 1e-4), ("high", 0.15)], ids=lambda each: str(each)
)
def test_of_a_table_fewer_pixels_rise_above_the_clearance(
    level: DepthNoiseLevel, left: float
) -> None:
    """Workspaces count what is more than 4 mm above the table as object."""
    noise = DEPTH_NOISE[level]
    assert noise is not None
    seen = noise.seen(view_of(np.full((240, 320), FAR_M)), np.random.default_rng(1))
    views = (seen, DepthFilter().seen(seen))
    above = [float(np.mean(view.depth_m < FAR_M - 0.004)) for view in views]
    assert above[1] <= min(left, 0.6 * above[0])


def test_a_filter_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(BadInputError, match="reaches 0 pixels"):
        DepthFilter(reach_px=0)
    with pytest.raises(BadInputError, match=r"steps of 0\.0 m"):
        DepthFilter(step_m=0.0)
