"""Lenses that distort, and images without it."""

import numpy as np
import pytest

from split_drake.bad_input import BadInputError
from split_drake.camera import Intrinsics
from split_drake.sensing.lens import Calibration, Lens

CAMERA = Intrinsics(200, 160, 150.0, 160.0, 98.0, 81.0)
BENT = Lens(0.15, -0.05, 0.004, -0.006, 0.02)


def test_a_point_is_where_opencv_shows_it() -> None:
    # By hand from the formula: r^2 = 0.13.
    x, y = 0.3, -0.2
    radial = 1 + 0.15 * 0.13 - 0.05 * 0.13**2 + 0.02 * 0.13**3
    expected = (
        x * radial + 2 * 0.004 * x * y - 0.006 * (0.13 + 2 * x * x),
        y * radial + 0.004 * (0.13 + 2 * y * y) + 2 * -0.006 * x * y,
    )
    np.testing.assert_allclose(BENT.distorted(np.array([x, y])), expected, rtol=1e-12)


def test_a_distorted_image_of_a_tilted_plane_is_that_plane_again() -> None:
    """A lens shows at its pixel what an ideal camera shows elsewhere."""
    calibration = Calibration(CAMERA, BENT)
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(float)
    xy = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy], axis=-1)
    # Where each of the lens's pixels looks, by fixed-point iteration: the inverse of `distorted`.
    ideal = xy.copy()
    for _ in range(50):
        ideal += xy - BENT.distorted(ideal)

    def plane(rays: np.ndarray) -> np.ndarray:
        return 1.0 / (1.0 + 0.3 * rays[..., 0] - 0.2 * rays[..., 1])

    image = plane(ideal).astype(np.float32)
    mended = np.asarray(calibration.undistorted(image))
    seen = mended > 0.0
    assert seen.mean() > 0.85
    error = np.abs(mended - plane(xy))[seen]
    raw = np.abs(image - plane(xy))[seen]
    assert error.max() < 0.003  # half a pixel's worth
    assert raw.max() > 4.0 * error.max()


def test_nothing_changes_without_distortion() -> None:
    image = np.arange(160.0 * 200.0).reshape(160, 200)
    np.testing.assert_array_equal(Calibration(CAMERA).undistorted(image), image)


def test_another_size_and_a_wild_lens_are_refused() -> None:
    with pytest.raises(
        BadInputError, match=r"shape \(200, 160\); the calibration says \(160, 200\)"
    ):
        Calibration(CAMERA).undistorted(np.zeros((200, 160)))
    with pytest.raises(BadInputError, match="k2 is 11"):
        Lens(k2=11.0)
    with pytest.raises(BadInputError, match="k1 is nan"):
        Lens(k1=float("nan"))
