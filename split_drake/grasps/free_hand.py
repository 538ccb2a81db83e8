"""Whether a grasp holds, in physics: a free hand closes on an object, carries and shakes it.

This is the paper's validation of grasps in simulation (section V).  What the object would feel in a
hand that lifts, turns and shakes it is applied at its centre of mass, the hand standing still; for
a hand that keeps its orientation that is exact but for the fingers' own inertia, and a hand that
turns slowly is one about which gravity turns.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, invert_pose, rotation_error_rad
from split_drake.station.config import StationConfig
from split_drake.station.hand_rig import HandRig

Fault = Literal["", "collides", "empty", "lost", "slipped"]

# As the planner closes: see `planning/motion/segment_builder.py`.
CLOSING_SPEED_M_S = 0.1
SQUEEZE_M = -0.05
SETTLE_S = 0.1
# Until a pad would touch at the next step of this size, closing is not simulated.
FREE_STEP_M = 0.004
# Fingers held back by so much push with all the force that they may use.
SATURATED_M = 0.022
# Pads closed further than this hold nothing; no mug's wall is as thin.
EMPTY_OPENING_M = 0.001

# What an object may do in a hand that holds it.
MAX_SLIP_M = 0.015
MAX_TURN_RAD = np.radians(25.0)
# The hand may reach into the collision pieces, which stand for the mesh within 1.5 mm, by this.
MAX_PENETRATION_M = 0.002

GRAVITY_M_S2 = 9.81
SHAKE_M_S2 = 5.0
SHAKE_S = 0.3
SHAKE_HZ = (4.0, 5.0, 6.5)
LIFT_M_S2 = 3.0
_STEP_S = 0.01
_STILL_STEP_S = 0.1


@dataclass(frozen=True)
class GraspOutcome:
    """What became of an object in the hand.

    Attributes:
        fault: why the grasp does not hold: the opened hand `collides` with object or table, it
            closes on nothing (`empty`), the object is `lost`, or moves too far (`slipped`).
        slip_m: how far the object's origin O moved in the hand at most, from when the hand had
            closed on; inf where there was nothing to move.
        turn_rad: how far it turned at most.
    """

    fault: Fault
    slip_m: float
    turn_rad: float

    @property
    def holds(self) -> bool:
        return not self.fault


@dataclass(frozen=True)
class HoldingOutcome:
    """What became of an object that a hand keeps still.

    Attributes:
        fault: as in `GraspOutcome`.
        penetration_m: the deepest that a pad and the object overlapped.
        slip_m: how far the object's origin O moved in the hand at most, once gravity acted.
        turn_rad: how far it turned at most.
        simulated_s: from the start of closing on.
    """

    fault: Fault
    penetration_m: float
    slip_m: float
    turn_rad: float
    simulated_s: float


def _failed(fault: Fault) -> GraspOutcome:
    return GraspOutcome(fault, float("inf"), float("inf"))


class FreeHand:
    """Tries grasps of one object."""

    def __init__(self, body: RigidObject, config: StationConfig) -> None:
        self._rig = HandRig(body, config)
        self._mass_kg = body.mass_kg

    def try_grasp(self, X_OG: Array, opening_m: float) -> GraspOutcome:
        """Try a grasp X_OG (4, 4) without a table, gravity turning about the closed hand.

        Gravity comes from where the palm is, then from both sides (along x_G, about the axis that
        the pads turn about most easily), then the hand shakes it.  The hand comes in with the pads
        `opening_m` apart.
        """
        self._rig.reset(invert_pose(X_OG), opening_m)
        return self._try(opening_m, np.zeros(3), _turns_and_shakes())

    def try_in_scene(self, X_WO: Array, X_WG: Array, opening_m: float) -> GraspOutcome:
        """Try a grasp X_WG (4, 4) of the object that rests on the table at X_WO (4, 4).

        The hand closes, lifts and shakes it, keeping its orientation.
        """
        X_GW = invert_pose(X_WG)
        self._rig.reset(X_GW @ X_WO, opening_m, X_GW)
        R_GW = X_GW[:3, :3]
        down_G = -GRAVITY_M_S2 * R_GW[:, 2]
        return self._try(opening_m, down_G, (R_GW @ a_W for a_W in _lift_and_shakes()))

    def hold_still(
        self, X_OG: Array, opening_m: float, down_G: Array, duration_s: float
    ) -> HoldingOutcome:
        """Close by a grasp X_OG (4, 4) and hold the object still for a while.

        Gravity points along the unit vector `down_G` (3,).  What moves too far ends it early.
        """
        self._rig.reset(invert_pose(X_OG), opening_m)
        self._close(self._close_freely(opening_m), np.zeros(3))
        depth_m, weight_G = self._rig.pad_penetration_m(), self._mass_kg * GRAVITY_M_S2 * down_G
        if self._rig.fingers_touching() < 2:
            return HoldingOutcome("empty", depth_m, float("inf"), float("inf"), self._rig.time_s)
        self._rig.advance(SETTLE_S, SQUEEZE_M, weight_G)
        X_GOHeld, slip_m, turn_rad = self._rig.X_GO, 0.0, 0.0
        fault: Fault = ""
        end_s = self._rig.time_s + duration_s
        while self._rig.time_s < end_s - 1e-9 and not fault:
            self._rig.advance(_STILL_STEP_S, SQUEEZE_M, weight_G)
            X_GO, depth_m = self._rig.X_GO, max(depth_m, self._rig.pad_penetration_m())
            slip_m = max(slip_m, float(np.linalg.norm(X_GO[:3, 3] - X_GOHeld[:3, 3])))
            turn_rad = max(turn_rad, float(rotation_error_rad(X_GO[:3, :3], X_GOHeld[:3, :3])))
            if slip_m > MAX_SLIP_M or turn_rad > MAX_TURN_RAD:
                fault = "slipped"
        return HoldingOutcome(fault, depth_m, slip_m, turn_rad, self._rig.time_s)

    def _try(self, opening_m: float, closing_G: Array, carrying_G: Iterator[Array]) -> GraspOutcome:
        """Close, then carry; `closing_G` and `carrying_G` are accelerations (3,) that it feels."""
        if self._rig.hand_penetration_m() > MAX_PENETRATION_M:
            return _failed("collides")
        self._close(self._close_freely(opening_m), self._mass_kg * closing_G)
        if self._rig.opening_m < EMPTY_OPENING_M or self._rig.fingers_touching() < 2:
            return _failed("empty")
        self._rig.take_table_away()
        X_GOClosed, slip_m, turn_rad = self._rig.X_GO, 0.0, 0.0
        for a_G in carrying_G:
            self._rig.advance(_STEP_S, SQUEEZE_M, self._mass_kg * a_G)
            X_GO = self._rig.X_GO
            slip_m = max(slip_m, float(np.linalg.norm(X_GO[:3, 3] - X_GOClosed[:3, 3])))
            turn = rotation_error_rad(X_GO[:3, :3], X_GOClosed[:3, :3])
            turn_rad = max(turn_rad, float(turn))
            if slip_m > MAX_SLIP_M or turn_rad > MAX_TURN_RAD:
                return GraspOutcome("slipped", slip_m, turn_rad)
        fault: Fault = "" if self._rig.fingers_touching() == 2 else "lost"
        return GraspOutcome(fault, slip_m, turn_rad)

    def _close_freely(self, opening_m: float) -> float:
        """Bring the pads close to the object, which costs no simulation; return their opening."""
        while opening_m > FREE_STEP_M:
            self._rig.place_fingers(opening_m - FREE_STEP_M)
            if self._rig.hand_penetration_m() > 0.0:
                break
            opening_m -= FREE_STEP_M
        self._rig.place_fingers(opening_m)
        return opening_m

    def _close(self, opening_m: float, f_G: Array) -> None:
        """Close slowly until the fingers squeeze whatever is between them with all their force."""
        for commanded_m in np.arange(opening_m, SQUEEZE_M, -CLOSING_SPEED_M_S * _STEP_S):
            self._rig.advance(_STEP_S, float(commanded_m), f_G)
            if self._rig.opening_m - commanded_m > SATURATED_M:
                break
        self._rig.advance(SETTLE_S, SQUEEZE_M, f_G)


def _turns_and_shakes() -> Iterator[Array]:
    """Yield the accelerations (3,) in G that the object feels, one a step."""
    down, side = np.array([0.0, 0.0, GRAVITY_M_S2]), np.array([GRAVITY_M_S2, 0.0, 0.0])
    # From one direction to the next within 0.1 s, then held.
    corners = (np.zeros(3), down, down, side, side, -side, -side, down)
    durations_s = (0.05, 0.05, 0.1, 0.12, 0.15, 0.12, 0.1)
    for start, end, duration_s in zip(corners[:-1], corners[1:], durations_s, strict=True):
        steps = round(duration_s / _STEP_S)
        for share in np.arange(1, steps + 1) / steps:
            yield start + share * (end - start)
    for shake in _shakes():
        yield down + shake


def _lift_and_shakes() -> Iterator[Array]:
    """Yield the accelerations (3,) in W that the object feels, one a step."""
    down = np.array([0.0, 0.0, -GRAVITY_M_S2])
    for _ in range(round(0.2 / _STEP_S)):
        yield down * (1.0 + LIFT_M_S2 / GRAVITY_M_S2)
    for shake in _shakes():
        yield down + shake


def _shakes() -> Iterator[Array]:
    """Yield accelerations (3,), one a step, of a hand that shakes along all axes at once."""
    times_s = np.arange(1, round(SHAKE_S / _STEP_S) + 1) * _STEP_S
    for time_s in times_s:
        yield SHAKE_M_S2 * np.sin(2.0 * np.pi * np.array(SHAKE_HZ) * time_s)
