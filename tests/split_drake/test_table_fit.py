"""The scale of depth images, told by the table that they show."""

from dataclasses import replace

import numpy as np
import pytest

from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.scene import EmptySceneError
from split_drake.table_fit import TableFit, table_depth

TABLE_Z_M = 0.1
INTRINSICS = Intrinsics.centered(160, 120, focal_px=135.0)
X_WC = look_at((0.0, -0.5, 0.5), (0.0, 0.0, 0.15))


def table_view(box_height_m: float = 0.0) -> DepthView:
    """Return a view of the table; a third of the image shows a plane that is higher."""
    blank = DepthView(np.zeros((120, 160), np.float32), INTRINSICS, X_WC)
    depth_m = table_depth(blank, TABLE_Z_M).astype(np.float32)
    depth_m[:, 60:110] = table_depth(blank, TABLE_Z_M + box_height_m)[:, 60:110]
    return replace(blank, depth_m=depth_m)


def scaled(view: DepthView, factor: float, noise_m: float = 0.0) -> DepthView:
    noise = np.random.default_rng(0).normal(0.0, noise_m, view.depth_m.shape)
    return replace(view, depth_m=(view.depth_m * factor + noise).astype(np.float32))


def test_points_of_the_table_have_its_height() -> None:
    heights = table_view().points()[:, 2]
    np.testing.assert_allclose(heights, TABLE_Z_M, atol=1e-6)


@pytest.mark.parametrize("factor", [0.91, 0.97, 1.0, 1.06])
@pytest.mark.parametrize("noise_m", [0.0, 0.005])
def test_the_factor_of_an_image_is_found(factor: float, noise_m: float) -> None:
    fit = TableFit.of(scaled(table_view(0.06), factor, noise_m), TABLE_Z_M)
    assert fit.factor == pytest.approx(factor, abs=0.001)
    assert fit.spread == pytest.approx(noise_m / 0.62, abs=0.0025)
    assert fit.pixels > 6000


def test_what_stands_on_the_table_keeps_its_height_and_the_table_goes() -> None:
    measured = scaled(table_view(0.06), 0.96, 0.003)
    fit = TableFit.of(measured, TABLE_Z_M)
    right = fit.rescaled(measured)
    assert np.median(right.points()[:, 2]) == pytest.approx(TABLE_Z_M, abs=0.001)
    view = fit.above_table(right, TABLE_Z_M)
    heights = view.points(TABLE_Z_M + 0.004)[:, 2]
    box = 50 * 120
    assert len(heights) == pytest.approx(box, rel=0.03)
    assert np.median(heights) == pytest.approx(TABLE_Z_M + 0.06, abs=0.001)


def test_an_image_without_a_table_is_refused() -> None:
    nothing = replace(table_view(), depth_m=np.zeros((120, 160), np.float32))
    with pytest.raises(EmptySceneError, match=r"0 pixels show a table at the height 0\.1 m"):
        TableFit.of(nothing, TABLE_Z_M)
    with pytest.raises(EmptySceneError, match="expected more than 500"):
        TableFit.of(scaled(table_view(), 0.5), TABLE_Z_M)


def test_the_horizon_has_no_table() -> None:
    level = replace(table_view(), X_WC=look_at((0.0, -0.5, 0.5), (0.0, 0.0, 0.5)))
    depth_m = table_depth(level, TABLE_Z_M)
    assert np.isinf(depth_m[:59]).all()
    assert np.isfinite(depth_m[61:]).all()
