"""How a grasp is tried in clutter: VGN's protocol (arXiv 2101.01132, section V).

The opened hand starts 5 cm back, goes straight in until it touches something or is there, closes,
and goes 10 cm back, or up where it came in from the side.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from split_drake.poses import Array, check_poses
from split_drake.robot.gripper import MAX_FORCE_N
from split_drake.station.hand.hand_station import HandStation

PREGRASP_M = 0.05
CLOSING_S = 0.5
RETREAT_M = 0.10
# Approaches further from straight down than this retreat upwards.
SIDE_RAD = np.radians(60.0)
# Pads closed further than this hold nothing.
MIN_OPENING_M = 0.008

Stage = Literal["pregrasp", "approach", "retreat"]


@dataclass(frozen=True)
class GraspExecution:
    """What became of a grasp that was tried.

    Attributes:
        stage: the last one that was gone through.
        reason: why it failed; empty on success.
        stopped_by: the bodies that ended the pregrasp or the approach, by name, in order.
        short_m: how far before the grasp the hand stopped for them.
        held: the objects that the hand touches in the end, by name, in the station's order.
        opening_m: distance between the pads in the end.
    """

    stage: Stage
    reason: str
    stopped_by: tuple[str, ...]
    short_m: float
    held: tuple[str, ...]
    opening_m: float

    @property
    def success(self) -> bool:
        return not self.reason


def execute_grasp(
    station: HandStation,
    X_WG: Array,
    touching_allowed: bool = True,
    force_n: float = MAX_FORCE_N,
) -> GraspExecution:
    """Try a grasp X_WG (4, 4); the hand stays where it ends, with what it holds.

    Args:
        touching_allowed: whether a hand that touches something on its way in closes there, as in
            evaluation, or has failed, as for labels.
        force_n: limit of each finger's force.

    Raises RuntimeError where Drake's contact solver fails.
    """
    X_WG = check_poses(X_WG, "X_WG")
    p_WG, approach_W = X_WG[:3, 3], X_WG[:3, 2]
    X_WPregrasp = X_WG.copy()
    X_WPregrasp[:3, 3] -= PREGRASP_M * approach_W
    station.place_hand(X_WPregrasp)
    if touched := station.touching():
        return _stopped(station, "pregrasp", touched, PREGRASP_M)
    stopped_by: frozenset[str] = frozenset()
    if not station.move(p_WG, stop_at_contact=True):
        stopped_by = station.touching()
    short_m = max(0.0, float(approach_W @ (p_WG - station.X_WG[:3, 3])))
    if stopped_by and not touching_allowed:
        return _stopped(station, "approach", stopped_by, short_m)
    station.close(CLOSING_S, force_n)
    station.move(station.X_WG[:3, 3] + RETREAT_M * retreat_direction(approach_W))
    held = objects_touched(station)
    reason = _fault(held, station.opening_m)
    if reason and stopped_by:
        reason += f"; it was stopped {1e3 * short_m:.0f} mm before the grasp by {_list(stopped_by)}"
    return GraspExecution(
        "retreat", reason, tuple(sorted(stopped_by)), short_m, held, station.opening_m
    )


def retreat_direction(approach_W: Array) -> Array:
    """Return the unit vector (3,) along which a hand that came along `approach_W` (3,) retreats."""
    from_down_rad = np.arccos(np.clip(-approach_W[2], -1.0, 1.0))
    return np.array([0.0, 0.0, 1.0]) if from_down_rad > SIDE_RAD else -approach_W


def objects_touched(station: HandStation) -> tuple[str, ...]:
    """Return the names of the objects that the hand touches now, in the station's order."""
    touching = station.touching()
    return tuple(item.name for item in station.objects if item.name in touching)


def _fault(held: tuple[str, ...], opening_m: float) -> str:
    if not held:
        return "the hand holds nothing"
    if opening_m <= MIN_OPENING_M:
        return f"the pads closed to {1e3 * opening_m:.1f} mm"
    return ""


def _stopped(
    station: HandStation, stage: Stage, touched: frozenset[str], short_m: float
) -> GraspExecution:
    reason = f"the hand touches {_list(touched)} {1e3 * short_m:.0f} mm before the grasp"
    return GraspExecution(
        stage, reason, tuple(sorted(touched)), short_m, objects_touched(station), station.opening_m
    )


def _list(names: Iterable[str]) -> str:
    return ", ".join(sorted(names))
