"""How near a trial came to the robot's limits, from the simulation's log."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from weakref import WeakMethod

import numpy as np
from pydrake.systems.framework import Context

from split_drake.robot.panda import arm_limits, weight_torques_nm
from split_drake.station.station import Station
from split_drake.truth.state import Truth

MAX_PAD_DEPTH_M = 0.002
# Pads are looked at this often, the joints of all steps so many looks at a time.
_LOOK_S = 0.01
_LOOKS_A_READING = 10


@dataclass(frozen=True)
class Peaks:
    """The extremes of a trial.

    Attributes:
        position_margin_rad: least distance of a joint from the end of its range, negative beyond.
        velocity_share: largest share of a joint's velocity limit.
        torque_share: largest share of a joint's torque limit, the torque that carries the arm's
            own weight included.
        pad_depth_m: deepest overlap of the pads' and the mug's collision shapes.
        fixture_depth_m: deepest overlap of the robot's with the table's and the hook's.
    """

    position_margin_rad: float = float("inf")
    velocity_share: float = 0.0
    torque_share: float = 0.0
    pad_depth_m: float = 0.0
    fixture_depth_m: float = 0.0

    def exceeded(self) -> tuple[str, ...]:
        """Return what went beyond its limit, with the values."""
        checks = (
            (self.position_margin_rad < 0.0, f"range by {-self.position_margin_rad:.3f} rad"),
            (self.velocity_share > 1.0, f"velocity {self.velocity_share:.0%}"),
            (self.torque_share > 1.0, f"torque {self.torque_share:.0%}"),
            (self.pad_depth_m > MAX_PAD_DEPTH_M, f"pads {1e3 * self.pad_depth_m:.1f} mm deep"),
            (self.fixture_depth_m > 0.0, f"robot {1e3 * self.fixture_depth_m:.1f} mm in fixtures"),
        )
        return tuple(text for beyond, text in checks if beyond)

    def rounded(self) -> dict[str, float]:
        """Return the numbers as a record keeps them."""
        return {name: round(value, 6) for name, value in asdict(self).items()}


def worst(peaks: Iterable[Peaks]) -> Peaks | None:
    """Return the worst of each number; None where there are no peaks."""
    every = list(peaks)
    if not every:
        return None
    return Peaks(
        min(each.position_margin_rad for each in every),
        max(each.velocity_share for each in every),
        max(each.torque_share for each in every),
        max(each.pad_depth_m for each in every),
        max(each.fixture_depth_m for each in every),
    )


class LimitLog:
    """Watches a station from the log's making on; uses the simulator's one monitor.

    Args:
        station: that is logged, with the mug as its first object.
        truth: of the station.
    """

    def __init__(self, station: Station, truth: Truth) -> None:
        self._station = station
        self._truth = truth
        self._limits = arm_limits()
        self._margin_rad = float("inf")
        self._velocity = self._torque = self._depth_m = self._fixture_depth_m = 0.0
        self._looks = 0
        self._next_look_s = station.time_s
        station.take_log()  # what came before is no part of what is watched
        # The simulator would keep what it calls, and this keeps the simulator.
        watching: WeakMethod[Callable[[Context], None]] = WeakMethod(self._watch)
        station.simulator.set_monitor(lambda context: _call(watching, context))

    @property
    def peaks(self) -> Peaks:
        """The extremes so far."""
        self._look()
        self._read_joints()
        depths = (self._depth_m, self._fixture_depth_m)
        return Peaks(self._margin_rad, self._velocity, self._torque, *depths)

    def _watch(self, context: Context) -> None:
        if context.get_time() > self._next_look_s - 1e-9:
            self._look()
            self._next_look_s += _LOOK_S

    def _look(self) -> None:
        """Take in how deep the robot was in something, and from time to time its joints."""
        depth_m, fixture_depth_m = self._truth.robot_depths_m()
        self._depth_m = max(self._depth_m, depth_m)
        self._fixture_depth_m = max(self._fixture_depth_m, fixture_depth_m)
        self._looks += 1
        if self._looks % _LOOKS_A_READING == 0:
            self._read_joints()

    def _read_joints(self) -> None:
        """Take in the joints in the steps since they were read last, and the arm's weight.

        That changes evenly in so short a time.
        """
        states, torques_nm = self._station.take_log()
        if not len(states):
            return
        limits, qs, vs = self._limits, states[:, :7], states[:, 9:16]
        margin = min((qs - limits.q_lower).min(), (limits.q_upper - qs).min())
        self._margin_rad = min(self._margin_rad, float(margin))
        self._velocity = max(self._velocity, float((np.abs(vs) / limits.v_max).max()))
        carried_nm = torques_nm + np.linspace(
            weight_torques_nm(qs[0]), weight_torques_nm(qs[-1]), len(qs)
        )
        self._torque = max(self._torque, float((np.abs(carried_nm) / limits.effort_max_nm).max()))


def _call(watching: WeakMethod[Callable[[Context], None]], context: Context) -> None:
    watch = watching()
    if watch is not None:
        watch(context)
