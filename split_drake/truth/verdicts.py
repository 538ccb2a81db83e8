"""Whether a mug hangs or stands, judged by the simulator's truth."""

from dataclasses import dataclass

import numpy as np
import shapely

from split_drake.objects.mug_shape import MugShape
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.station.fixtures import HOOK_BODY, TABLE_BODY
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from split_drake.truth.rest import WATCH_STEP_S, axis_tilt_rad, wait_for_rest
from split_drake.truth.state import Truth

HANG_WAIT_S = 3.0
HANG_WATCH_S = 1.0
HANG_HEIGHT_M = 0.15
UPRIGHT_TOLERANCE_RAD = np.radians(5.0)


@dataclass(frozen=True)
class Verdict:
    """The outcome of a task.

    Attributes:
        success: whether it was reached.
        reason: what was wrong; empty on success.
    """

    success: bool
    reason: str = ""


def hang_verdict(
    station: Station, truth: Truth, mug: MugShape, release_time_s: float, index: int = 0
) -> Verdict:
    """Simulate through the fourth second after release, and judge whether object `index` hangs.

    Where that second has begun already, the one from now on counts.  Throughout it the peg's axis
    must cross the handle's opening, the mug must touch nothing but the hook, and its centre of mass
    must be within 15 cm of the peg's height; in each half of the second it must touch the hook.
    """
    station.advance(max(0.0, release_time_s + HANG_WAIT_S - station.time_s))
    for _ in range(2):
        touched = False
        for _ in range(round(HANG_WATCH_S / 2.0 / WATCH_STEP_S)):
            station.advance(WATCH_STEP_S)
            fault = _hang_fault(truth, mug, station.config.layout, index)
            if fault:
                return Verdict(False, fault)
            touched |= HOOK_BODY in truth.touching(index)
        if not touched:
            return Verdict(False, "half a second without touching the hook")
    return Verdict(True)


def _hang_fault(truth: Truth, mug: MugShape, layout: Layout, index: int) -> str:
    """Return what is wrong with the hanging mug at this moment, or an empty string."""
    below_m = float(layout.X_WK[2, 3] - truth.p_WCom(index)[2])
    if abs(below_m) > HANG_HEIGHT_M:
        return f"the centre of mass is {below_m:.2f} m below the peg"
    if not peg_in_opening(truth.X_WO(index), mug, layout):
        return "the peg is not in the handle"
    others = truth.touching(index) - {HOOK_BODY}
    return f"the mug touches {', '.join(sorted(others))}" if others else ""


def peg_in_opening(X_WO: Array, mug: MugShape, layout: Layout) -> bool:
    """Return whether the peg's axis, from post to tip, crosses the opening of a mug at X_WO."""
    ends_K = np.array(
        [[0.0, -layout.hook.post_distance_m, 0.0], [0.0, layout.hook.tip_distance_m, 0.0]]
    )
    root, tip = transform_points(invert_pose(X_WO) @ layout.X_WK, ends_K)
    if root[1] * tip[1] >= 0.0:
        return False
    x, _, z = root + (tip - root) * root[1] / (root[1] - tip[1])
    opening = shapely.Polygon(mug.opening_OPs[:, [0, 2]])
    return bool(shapely.contains_xy(opening, x, z))


def reorient_verdict(
    station: Station, truth: Truth, index: int = 0, timeout_s: float = 3.0
) -> Verdict:
    """Simulate until object `index` rests, and judge whether it stands upright on the table.

    Its axis must be within 5 degrees of vertical, rim up, and it must touch only the table.
    """
    if not wait_for_rest(station, truth, index, timeout_s):
        return Verdict(False, f"still moving after {timeout_s:g} s")
    touching = truth.touching(index)
    if touching != {TABLE_BODY}:
        return Verdict(False, f"the mug touches {', '.join(sorted(touching)) or 'nothing'}")
    tilt_rad = axis_tilt_rad(truth.X_WO(index))
    if tilt_rad > UPRIGHT_TOLERANCE_RAD:
        return Verdict(False, f"the axis is {np.degrees(tilt_rad):.0f} degrees off upright")
    return Verdict(True)
