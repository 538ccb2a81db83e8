"""A camera as it is calibrated: a pinhole behind a lens that distorts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.camera import Intrinsics, pixel_rays
from split_drake.poses import Array

# Beyond this an image would be turned inside out; nobody's lens does that to a depth camera.
_MOST = 10.0


@dataclass(frozen=True)
class Lens:
    """Radial and tangential distortion by OpenCV's first five coefficients (Brown and Conrady).

    Attributes:
        k1, k2, p1, p2, k3: coefficients, in OpenCV's order.
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("k1", "k2", "p1", "p2", "k3"):
            if abs(getattr(self, name)) > _MOST:
                raise BadInputError(
                    f"the distortion's {name} is {getattr(self, name)}; expected one of OpenCV's "
                    f"k1, k2, p1, p2, k3, none beyond {_MOST:g}"
                )

    @property
    def distorts(self) -> bool:
        """Whether there is any distortion."""
        return any((self.k1, self.k2, self.p1, self.p2, self.k3))

    def distorted(self, xy: Array) -> Array:
        """Return where the lens shows what an ideal camera would show at `xy` (..., 2).

        Both are in the image plane at depth 1.  The formula is that of OpenCV's camera
        calibration (docs.opencv.org, "Camera Calibration and 3D Reconstruction").
        """
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        return np.stack(
            [
                x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
                y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
            ],
            axis=-1,
        )


@dataclass(frozen=True)
class Calibration:
    """What a camera's calibration says: its pinhole, and its lens."""

    intrinsics: Intrinsics
    lens: Lens = Lens()

    def undistorted(self, image: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return the image (H, W) that the pinhole alone would have taken.

        Each pixel takes the value of the nearest one, since a mean of depths across an edge is the
        depth of nothing.  What lies outside of the image is 0.

        Raises BadInputError where the image has another size than the intrinsics say.
        """
        expected = (self.intrinsics.height, self.intrinsics.width)
        if image.shape != expected:
            raise BadInputError(
                f"the image has shape {image.shape}; the calibration says {expected}"
            )
        if not self.lens.distorts:
            return image
        camera = self.intrinsics
        xy = self.lens.distorted(pixel_rays(camera)[..., :2].astype(float))
        pixels = np.rint(xy * (camera.fx, camera.fy) + (camera.cx, camera.cy)).astype(int)
        inside = np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=-1)
        result = np.zeros_like(image)
        result[inside] = image[pixels[inside, 1], pixels[inside, 0]]
        return result
