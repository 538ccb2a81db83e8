"""Whether a peg along a handle pose would pass through the handle, which is what hanging needs."""

import numpy as np
import shapely
from numpy.typing import NDArray

from split_drake.objects.mug_shape import MugShape
from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array, invert_pose, transform_points

PEG_RADIUS_M = 0.006
# From the pose's origin to either end of the peg; beyond the body and the grip of any mug's handle.
PEG_REACH_M = 0.04
# Lines on the peg's surface lie 1.2 mm apart: what comes between two of them is 0.03 mm deep there.
_LINES_OF_RING = ((PEG_RADIUS_M, 32), (PEG_RADIUS_M / 2.0, 8), (0.0, 1))


def _lines() -> Array:
    """Return (L, 2, 3) start and end, in the handle frame H, of lines that fill the peg along y."""
    rings = []
    for radius_m, count in _LINES_OF_RING:
        angle = 2.0 * np.pi * np.arange(count) / count
        x, z = radius_m * np.cos(angle), radius_m * np.sin(angle)
        ends = [np.column_stack([x, np.full(count, y), z]) for y in (-PEG_REACH_M, PEG_REACH_M)]
        rings.append(np.stack(ends, axis=1))
    return np.concatenate(rings)


class PegTest:
    """Tries pegs, 12 mm thick and 8 cm long, along y of handle poses of one mug."""

    def __init__(self, mug: MugShape) -> None:
        self._caster = RayCaster(mug.body.mesh)
        self._opening = shapely.Polygon(mug.opening_OPs[:, [0, 2]])
        self._lines_H = _lines()

    def clear(self, X_WO: Array, X_WHs: Array) -> NDArray[np.bool_]:
        """Return (N,): whether the peg of each pose (N, 4, 4) passes through the handle's opening.

        The mug is at X_WO (4, 4).  The peg must miss its mesh, and its axis must cross the opening.
        """
        X_OHs = invert_pose(X_WO) @ X_WHs
        return self._misses(X_OHs) & self._crosses(X_OHs)

    def _misses(self, X_OHs: Array) -> NDArray[np.bool_]:
        """Return (N,): whether none of the lines that fill the peg meets the mesh."""
        starts, ends = (transform_points(X_OHs, self._lines_H[:, end]) for end in (0, 1))
        shares, _ = self._caster.cast(starts.reshape(-1, 3), (ends - starts).reshape(-1, 3))
        return np.all(shares.reshape(starts.shape[:2]) > 1.0, axis=1)

    def _crosses(self, X_OHs: Array) -> NDArray[np.bool_]:
        """Return (N,): whether the peg's axis crosses the plane y = 0 of O within the opening."""
        p_OHs, reach = X_OHs[:, :3, 3], PEG_REACH_M * X_OHs[:, :3, 1]
        starts, ends = p_OHs - reach, p_OHs + reach
        across = starts[:, 1] * ends[:, 1] < 0.0
        span = np.where(across, starts[:, 1] - ends[:, 1], 1.0)
        crossings = starts + (starts[:, 1] / span)[:, None] * (ends - starts)
        return across & shapely.contains_xy(self._opening, crossings[:, 0], crossings[:, 2])
