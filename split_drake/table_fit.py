"""Depth images whose scale is off, put right by the table that they show.

Some sensors misjudge all distances of an image by one factor, by some per cent.  Where the camera's
pose and the table's height are known, the pixels that show the table tell the factor.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.ndimage import uniform_filter1d

from split_drake.camera import DepthView, pixel_rays
from split_drake.poses import Array
from split_drake.scene import EmptySceneError

# Factors outside this range are not looked for.
LEAST_FACTOR, GREATEST_FACTOR = 0.85, 1.15
# The fullest bin of a histogram, smoothed over some of them, is near the factor.
_BIN, _SMOOTHED_BINS = 0.001, 9
# The table's pixels lie within this of it; half as much after the first of these rounds.
_NEAR, _ROUNDS = 0.02, 4
# Of this many pixels that show the table, or fewer, no factor is told.
LEAST_PIXELS = 500
# What stands this many standard deviations of the table's noise above it is no table.
CLEAR_SPREADS = 3.0


@dataclass(frozen=True)
class TableFit:
    """What the table's pixels tell of a depth image.

    Attributes:
        factor: of measured over true depth.
        spread: standard deviation of that ratio among the table's pixels, robust against others.
        pixels: how many show the table.
    """

    factor: float
    spread: float
    pixels: int

    @classmethod
    def of(cls, view: DepthView, table_z_m: float) -> Self:
        """Return the fit of the horizontal table at the height `table_z_m` in W.

        Raises EmptySceneError where too few pixels show a table.
        """
        table_m = table_depth(view, table_z_m)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = (view.depth_m / table_m).ravel()
        ratios = ratios[(ratios > LEAST_FACTOR) & (ratios < GREATEST_FACTOR)]
        factor, near = _fullest(ratios), _NEAR
        spread = 0.0
        for _ in range(_ROUNDS):
            close = ratios[np.abs(ratios - factor) < near]
            if len(close) <= LEAST_PIXELS:
                raise EmptySceneError(
                    f"{len(close)} pixels show a table at the height {table_z_m:g} m, give or take "
                    f"{100 * (1 - LEAST_FACTOR):.0f}%; expected more than {LEAST_PIXELS}"
                )
            factor = float(np.median(close))
            # Objects stand above the table: its own noise is told by the ratios beyond.
            beyond = close[close >= factor] - factor
            spread = float(np.sqrt((beyond**2).mean()))
            near = min(_NEAR, max(4.0 * spread, 2.0 * _BIN))
        return cls(factor, spread, len(close))

    def rescaled(self, view: DepthView) -> DepthView:
        """Return the view with its scale put right."""
        return replace(view, depth_m=view.depth_m / np.float32(self.factor))

    def above_table(self, view: DepthView, table_z_m: float) -> DepthView:
        """Return a rescaled view without the table, and what noise lifts off it.

        Pixels within `CLEAR_SPREADS` of the table show nothing afterwards.
        """
        spread = CLEAR_SPREADS * self.spread / self.factor
        nearest_m = table_depth(view, table_z_m) * (1.0 - spread)
        above = view.depth_m < nearest_m
        return replace(view, depth_m=np.where(above, view.depth_m, np.float32(0.0)))


def table_depth(view: DepthView, table_z_m: float) -> Array:
    """Return the depth (H, W) that a table at this height in W has; inf above the horizon."""
    sinks = pixel_rays(view.intrinsics) @ view.X_WC[2, :3]
    with np.errstate(divide="ignore"):
        depth_m = (table_z_m - view.X_WC[2, 3]) / sinks
    return np.where(depth_m > 0.0, depth_m, np.inf)


def _fullest(ratios: Array) -> float:
    """Return about where most ratios lie."""
    edges = np.arange(LEAST_FACTOR, GREATEST_FACTOR + _BIN, _BIN)
    counts, _ = np.histogram(ratios, edges)
    smooth = uniform_filter1d(counts.astype(float), _SMOOTHED_BINS)
    return float(edges[smooth.argmax()] + _BIN / 2.0)
