"""Fields of depth views: where the surface is, what is free, what was not seen."""

import numpy as np
import pytest
from numpy.typing import NDArray

from split_drake.baselines.tsdf import RESOLUTION, TRUNCATION_VOXELS, UNSEEN, fused_tsdf
from split_drake.camera import DepthView, Intrinsics, look_at, pixel_rays
from split_drake.poses import Array
from split_drake.scene import Workspace

WORKSPACE = Workspace()
CAMERA = Intrinsics.centered(320, 240, 270.0)
VOXEL_M = WORKSPACE.edge_m / RESOLUTION
# Of voxels, above the cube's bottom.
TABLE = WORKSPACE.depth_below_m / VOXEL_M


def table_view(p_WC: tuple[float, float, float], shift_m: float = 0.0) -> DepthView:
    """Return a view of an endless table at z = 0 from a camera that looks at its middle."""
    X_WC = look_at(p_WC, WORKSPACE.p_WCenter, down_W=(-1.0, 0.0, 0.0))
    rays_W = pixel_rays(CAMERA) @ X_WC[:3, :3].T
    depth = (shift_m - p_WC[2]) / np.minimum(rays_W[..., 2], -1e-3)
    return DepthView(depth.astype(np.float32), CAMERA, X_WC)


def column(field: NDArray[np.float32]) -> Array:
    """Return the field above the workspace's middle, from the bottom up."""
    return np.asarray(field[RESOLUTION // 2, RESOLUTION // 2])


@pytest.mark.parametrize("p_WC", [(0.5, 0.0, 0.6), (0.5, -0.4, 0.45)])
def test_the_field_is_the_distance_along_the_ray(p_WC: tuple[float, float, float]) -> None:
    found = column(fused_tsdf([table_view(p_WC)], WORKSPACE))
    above = np.arange(RESOLUTION) + 0.5 - TABLE
    slant = np.linalg.norm(np.subtract(p_WC, WORKSPACE.p_WCenter)) / p_WC[2]
    expected = np.clip(above * slant / TRUNCATION_VOXELS, -1.0, 1.0) / 2.0 + 0.5
    near = np.abs(above * slant) < TRUNCATION_VOXELS - 0.5
    assert near.sum() >= 5
    assert found[near] == pytest.approx(expected[near], abs=0.03)
    assert (found[np.abs(above * slant) > TRUNCATION_VOXELS + 0.5] == UNSEEN).all()


def test_views_are_averaged() -> None:
    place = (0.5, 0.0, 0.6)
    views = [table_view(place, shift) for shift in (-0.5 * VOXEL_M, 0.5 * VOXEL_M)]
    one, other = (column(fused_tsdf([view], WORKSPACE)) for view in views)
    both = column(fused_tsdf(views, WORKSPACE))
    seen = (one > UNSEEN) & (other > UNSEEN)
    assert both[seen] == pytest.approx((one[seen] + other[seen]) / 2.0, abs=1e-6)
    assert (one[seen] != other[seen]).any()


def test_pixels_that_saw_nothing_say_nothing() -> None:
    view = table_view((0.5, 0.0, 0.6))
    for nothing in (0.0, np.inf):
        blind = DepthView(np.full_like(view.depth_m, nothing), CAMERA, view.X_WC)
        assert (fused_tsdf([blind], WORKSPACE) == UNSEEN).all()
        np.testing.assert_array_equal(
            fused_tsdf([view, blind], WORKSPACE), fused_tsdf([view], WORKSPACE)
        )


def test_what_lies_outside_the_image_is_unseen() -> None:
    aside = look_at((0.5, 0.0, 0.6), (0.8, 0.0, 0.0), down_W=(-1.0, 0.0, 0.0))
    depth = np.full((CAMERA.height, CAMERA.width), 0.6, np.float32)
    field = fused_tsdf([DepthView(depth, CAMERA, aside)], WORKSPACE)
    assert (field[0] == UNSEEN).all()
    assert (field[-1] > UNSEEN).any()


def test_a_scene_without_views_is_named() -> None:
    with pytest.raises(ValueError, match="no depth views"):
        fused_tsdf([], WORKSPACE)
