"""Execution of plans: segments become commands every 10 ms, with what the robot itself measures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from planning.execution.faults import Fault, find_fault, force_limit_n
from planning.problem import SAMPLE_S, Segment, SegmentName, Stage
from split_drake.camera import DepthView
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.panda import gripper_force

# The force is not looked at while the arm gets moving, which takes force as well.
CONTACT_AFTER_S = 0.15
# What a hand feels from the start of its way back may grow by this factor, and up to this one of
# what it may feel otherwise.
GROWTH, MOST_GROWN = 1.3, 2.0
# Segments of an open hand that may touch what it let go of from their start on.
IN_OBJECT = (SegmentName.RETREAT, SegmentName.EASE)


class Robot(Protocol):
    """What the executor needs of a robot; `split_drake.station.station.Station` is one."""

    @property
    def q(self) -> Array: ...

    @property
    def opening_m(self) -> float: ...

    @property
    def joint_torques_nm(self) -> Array: ...

    def capture(self) -> Sequence[DepthView]:
        """Return what the depth cameras see now."""
        ...

    def command(self, q: Array, v: Array, opening_m: float, force_n: float) -> None:
        """Set the desired arm state (7,), (7,), the opening, and the limit of its force.

        The arm moves on from `q` at `v` until the next command, for 10 ms at most.
        """
        ...

    def advance(self, duration_s: float) -> None:
        """Let time pass."""
        ...


@dataclass(frozen=True)
class SegmentLog:
    """How one segment went.

    Attributes:
        name: of the segment.
        duration_s: for which it was executed, in simulated time.
        tracking_error_rad: largest error of any joint against its command, which moves on at the
            commanded velocity until the next one.
        opening_m: measured at the end.
        stopped_by_contact: whether it ended early because of a force that it felt.
        force_n: largest change of the force at the gripper, where the segment looks at it; of a
            hand that draws back, the largest force.
        ended_s: when it ended, in simulated time since the executor was made.
    """

    name: SegmentName
    duration_s: float
    tracking_error_rad: float
    opening_m: float
    stopped_by_contact: bool
    force_n: float = 0.0
    ended_s: float = 0.0


@dataclass(frozen=True)
class ExecutionResult:
    """How the execution of segments ended.

    Attributes:
        completed: whether all segments were executed.
        logs: one for each segment that was started.
        stage: where it failed; None where it completed.
        reason: of the failure; empty where it completed.
        fault: that ended it; None where it completed.
    """

    completed: bool
    logs: tuple[SegmentLog, ...]
    stage: Stage | None = None
    reason: str = ""
    fault: Fault | None = None

    @property
    def duration_s(self) -> float:
        return sum(log.duration_s for log in self.logs)

    @property
    def since_release_s(self) -> float:
        """Time since the fingers were open; raises ValueError where they never were."""
        names = [log.name for log in self.logs]
        if SegmentName.OPEN not in names:
            raise ValueError(f"nothing was released; the segments executed are {names}")
        released = names.index(SegmentName.OPEN) + 1
        return sum(log.duration_s for log in self.logs[released:])


OnStep = Callable[[Segment], None]


class Executor:
    """Runs the segments of plans on a robot, one at a time.

    Attributes:
        robot: as given.

    Args:
        robot: to be commanded.
        on_step: called after every 10 ms with the segment under way.
        stops_when_caught: whether a hand that draws back stops where it is caught.
    """

    def __init__(
        self, robot: Robot, on_step: OnStep | None = None, stops_when_caught: bool = True
    ) -> None:
        self.robot = robot
        self._on_step = on_step
        self._stops_when_caught = stops_when_caught
        self._samples = 0

    def execute(self, segments: Sequence[Segment], offset: Array | None = None) -> ExecutionResult:
        """Execute the segments; stop where one of them fails.

        Args:
            segments: to be executed.
            offset: (7,) by which the arm is away from where the first one starts, if it is: it
                keeps or sheds that as after a segment that a contact stopped.
        """
        logs: list[SegmentLog] = []
        offset = np.zeros(7) if offset is None else offset
        for segment in segments:
            opening_m = self.robot.opening_m
            log, offset = self._execute_segment(segment, offset)
            logs.append(log)
            found = find_fault(segment, log.stopped_by_contact, opening_m, log.opening_m)
            if found is not None:
                return ExecutionResult(False, tuple(logs), found.stage, found.reason, found.fault)
        return ExecutionResult(True, tuple(logs))

    def _execute_segment(self, segment: Segment, offset: Array) -> tuple[SegmentLog, Array]:
        """Execute a segment that starts `offset` (7,) away; return its log and the offset left.

        An arm that was stopped early keeps its offset while it lets go and draws back, where its
        place relative to the object counts, and sheds it on the next free motion.

        What is felt is the change since the segment's start, when the arm may carry something; a
        hand that draws back or is eased out carries nothing, but may touch something from the
        start, and stops where the force grows beyond its limit.
        """
        robot, trajectory = self.robot, segment.trajectory
        sheds = segment.name in (SegmentName.TRANSIT, SegmentName.TRANSFER)
        limit_n, torques = self._force_limit(segment)
        error, force = 0.0, 0.0
        samples = zip(trajectory.times_s, trajectory.qs, trajectory.vs, strict=True)
        for count, (time, q, v) in enumerate(samples, start=1):
            left = offset * (1.0 - _smooth(time / trajectory.duration_s)) if sheds else offset
            self._step(segment, q + left, v, time / trajectory.duration_s)
            error = max(error, float(np.abs(robot.q - q - left - SAMPLE_S * v).max()))
            if np.isfinite(limit_n) and time > CONTACT_AFTER_S:
                change = gripper_force(robot.q, robot.joint_torques_nm - torques)
                force = max(force, float(np.linalg.norm(change)))
            if force > limit_n:
                log = self._log(segment, count, error, force, stopped=True)
                return log, robot.q - trajectory.qs[-1]
        log = self._log(segment, len(trajectory.times_s), error, force, stopped=False)
        return log, np.zeros(7) if sheds else offset

    def _force_limit(self, segment: Segment) -> tuple[float, Array]:
        """Return the force, N, at which a segment stops, and the torques (7,) felt without any."""
        limit_n, torques = force_limit_n(segment), self.robot.joint_torques_nm
        if segment.name not in IN_OBJECT:
            return limit_n, torques
        if not self._stops_when_caught:
            return np.inf, np.zeros(7)
        at_start_n = float(np.linalg.norm(gripper_force(self.robot.q, torques)))
        return float(np.clip(GROWTH * at_start_n, limit_n, MOST_GROWN * limit_n)), np.zeros(7)

    def _step(self, segment: Segment, q: Array, v: Array, share: float) -> None:
        """Command a sample, `share` of its segment done, and let its time pass."""
        opening_m = min(segment.opening_at_m(share), MAX_OPENING_M)
        self.robot.command(q, v, opening_m, segment.force_n)
        self.robot.advance(SAMPLE_S)
        self._samples += 1
        if self._on_step is not None:
            self._on_step(segment)

    def _log(
        self, segment: Segment, count: int, error: float, force: float, stopped: bool
    ) -> SegmentLog:
        return SegmentLog(
            segment.name,
            SAMPLE_S * count,
            error,
            self.robot.opening_m,
            stopped,
            force,
            SAMPLE_S * self._samples,
        )


def joined(log: SegmentLog, *further: SegmentLog) -> SegmentLog:
    """Return the log of a segment that went on in further ones of the same name."""
    logs = (log, *further)
    return replace(
        logs[-1],
        duration_s=sum(each.duration_s for each in logs),
        tracking_error_rad=max(each.tracking_error_rad for each in logs),
        force_n=max(each.force_n for each in logs),
    )


def _smooth(share: float) -> float:
    """Return a step from 0 to 1 that starts and ends at rest."""
    return share * share * (3.0 - 2.0 * share)
