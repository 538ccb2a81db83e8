"""What drivers of depth cameras do to an image first: smooth surfaces, and drop strays.

Each pixel becomes the mean of those around it that lie on the same surface, as depth goes.  One
that has too few of these beside it, as a pixel that flies between an object and what stands behind,
shows nothing.  This is a bilateral filter with a box in place of both Gaussians (Tomasi and
Manduchi, "Bilateral filtering for gray and color images", 1998).
"""

from dataclasses import dataclass, replace

import numpy as np

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.camera import DepthView


@dataclass(frozen=True)
class DepthFilter:
    """How a depth image is smoothed.

    Attributes:
        reach_px: pixels to either side that count as around a pixel.
        step_m: pixels that are nearer or further by more are of another surface.
        least_share: of the pixels around one that must be of its surface, or it shows nothing.

    Raises BadInputError where one of them makes no sense.
    """

    reach_px: int = 3
    step_m: float = 0.008
    least_share: float = 0.3

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.reach_px < 1 or not self.step_m > 0.0 or not 0.0 <= self.least_share < 1.0:
            raise BadInputError(
                f"a depth filter reaches {self.reach_px} pixels, over steps of {self.step_m} m, "
                f"and wants a share of {self.least_share}; expected at least 1, more than 0, and "
                "from 0 to below 1"
            )

    def seen(self, view: DepthView) -> DepthView:
        """Return the smoothed view; what showed nothing shows nothing still."""
        depth = np.asarray(view.depth_m, dtype=np.float32)
        depth = np.where(np.isfinite(depth), depth, 0.0)
        reach = self.reach_px
        padded = np.pad(depth, reach)
        height, width = depth.shape
        total, count = np.zeros_like(depth), np.zeros_like(depth)
        for down in range(2 * reach + 1):
            for right in range(2 * reach + 1):
                other = padded[down : down + height, right : right + width]
                alike = (np.abs(other - depth) < self.step_m) & (other > 0.0)
                total += np.where(alike, other, 0.0)
                count += alike
        kept = (depth > 0.0) & (count >= self.least_share * (2 * reach + 1) ** 2)
        mean = np.divide(total, count, out=np.zeros_like(depth), where=kept)
        return replace(view, depth_m=mean)
