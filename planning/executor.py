"""Execution of plans: segments become commands every 10 ms, with what the robot itself measures."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planning.kinematics import gripper_jacobian
from planning.problem import Plan, Segment, SegmentName, Stage
from planning.timing import SAMPLE_S
from split_drake.gripper import MAX_OPENING_M
from split_drake.poses import Array

# Fingers closed further than this hold nothing.
EMPTY_OPENING_M = 0.001
# A change of the force at the gripper, against the segment's start, that counts as contact: a few
# newtons, below the weight of the lightest mug plus what pressing it down by a millimetre adds.
CONTACT_FORCE_N = 4.0
# The force is not looked at while the arm gets moving, which takes force as well.
CONTACT_AFTER_S = 0.15
# What failed where the hand turns out to be empty after a segment.
LOSS_STAGES = {
    SegmentName.CLOSE: Stage.GRASP,
    SegmentName.LIFT: Stage.GRASP,
    SegmentName.TRANSFER: Stage.TRANSPORT,
    SegmentName.INSERT: Stage.PLACEMENT,
}


class Robot(Protocol):
    """What the executor needs of a robot; `split_drake.station.Station` is one."""

    @property
    def q(self) -> Array: ...

    @property
    def opening_m(self) -> float: ...

    @property
    def joint_torques_nm(self) -> Array: ...

    def command(self, q: Array, v: Array, opening_m: float, force_n: float) -> None:
        """Set the desired arm state (7,), (7,), the opening, and the limit of its force."""
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
        tracking_error_rad: largest error of any joint against its command.
        opening_m: measured at the end.
        stopped_by_contact: whether it ended early because the object touched something.
    """

    name: SegmentName
    duration_s: float
    tracking_error_rad: float
    opening_m: float
    stopped_by_contact: bool


@dataclass(frozen=True)
class ExecutionResult:
    """How the execution of a plan ended.

    Attributes:
        completed: whether all segments were executed.
        logs: one for each segment that was started.
        stage: where it failed; None where it completed.
        reason: of the failure; empty where it completed.
    """

    completed: bool
    logs: tuple[SegmentLog, ...]
    stage: Stage | None = None
    reason: str = ""

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
    """

    def __init__(self, robot: Robot, on_step: OnStep | None = None) -> None:
        self.robot = robot
        self._on_step = on_step

    def run(self, plan: Plan) -> ExecutionResult:
        """Execute the plan; stop where the hand turns out to be empty while it should hold."""
        logs: list[SegmentLog] = []
        offset = np.zeros(7)
        for segment in plan.segments:
            log, offset = self._run_segment(segment, offset)
            logs.append(log)
            if self._lost(segment.name):
                reason = (
                    f"the hand is empty after {segment.name}: its opening is "
                    f"{1e3 * log.opening_m:.1f} mm"
                )
                return ExecutionResult(False, tuple(logs), LOSS_STAGES[segment.name], reason)
        return ExecutionResult(True, tuple(logs))

    def _lost(self, name: SegmentName) -> bool:
        return name in LOSS_STAGES and self.robot.opening_m < EMPTY_OPENING_M

    def _run_segment(self, segment: Segment, offset: Array) -> tuple[SegmentLog, Array]:
        """Execute a segment that starts `offset` (7,) away; return its log and the offset left.

        An arm that was stopped early keeps its offset while it lets go and draws back, where its
        place relative to the object counts, and sheds it on the next free motion.
        """
        robot, trajectory = self.robot, segment.trajectory
        sheds = segment.name in (SegmentName.TRANSIT, SegmentName.TRANSFER)
        torques, error = robot.joint_torques_nm, 0.0
        samples = zip(trajectory.times_s, trajectory.qs, trajectory.vs, strict=True)
        for count, (time, q, v) in enumerate(samples, start=1):
            share = time / trajectory.duration_s
            left = offset * (1.0 - _smooth(share)) if sheds else offset
            opening = segment.opening_start_m + share * (
                segment.opening_end_m - segment.opening_start_m
            )
            robot.command(q + left, v, min(opening, MAX_OPENING_M), segment.force_n)
            robot.advance(SAMPLE_S)
            if self._on_step is not None:
                self._on_step(segment)
            error = max(error, float(np.abs(robot.q - q - left).max()))
            if segment.stop_on_contact and time > CONTACT_AFTER_S:
                force = gripper_force(robot.q, robot.joint_torques_nm - torques)
                if np.linalg.norm(force) > CONTACT_FORCE_N:
                    stopped = robot.q - trajectory.qs[-1]
                    spent_s = SAMPLE_S * count
                    return SegmentLog(segment.name, spent_s, error, robot.opening_m, True), stopped
        spent_s = SAMPLE_S * len(trajectory.times_s)
        log = SegmentLog(segment.name, spent_s, error, robot.opening_m, False)
        return log, np.zeros(7) if sheds else offset


def gripper_force(q: Array, torques_nm: Array) -> Array:
    """Return the force (3,) in W at the gripper that best explains the joint torques (7,).

    The least-squares solution of tau = J^T f for the position Jacobian J at `q` (7,).
    """
    return np.asarray(np.linalg.lstsq(gripper_jacobian(q).T, torques_nm, rcond=None)[0], float)


def _smooth(share: float) -> float:
    """Return a step from 0 to 1 that starts and ends at rest."""
    return share * share * (3.0 - 2.0 * share)
