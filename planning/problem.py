"""What a planner is given and what it returns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from planning.plan_rows import PlanRow, export_rows
from planning.subgoal import AllowedContact, Subgoal
from split_drake.bad_input import require_numbers
from split_drake.pose_set import PoseSets
from split_drake.poses import Array
from split_drake.station.layout import Layout

SAMPLE_S = 0.01


class SegmentName(StrEnum):
    """The segments of a pick and place, in their order, and what recovery adds to them.

    `BACK_OUT` is the way back with a held object, `EASE` a small motion of a hand that is caught.
    """

    TRANSIT = "transit"
    APPROACH = "approach"
    CLOSE = "close"
    LIFT = "lift"
    TRANSFER = "transfer"
    INSERT = "insert"
    OPEN = "open"
    RETREAT = "retreat"
    BACK_OUT = "back out"
    EASE = "ease"


@dataclass(frozen=True)
class JointTrajectory:
    """Arm positions over time, from rest to rest.

    One sample is executed every 10 ms (`SAMPLE_S`), whatever `times_s` says, and the arm moves on
    from it at its velocity.  `planning.motion.timing.time_path` samples a path so, and the check of
    plans refuses any other.

    Attributes:
        times_s: (T,) ascending from 0.
        qs: (T, 7) joint angles, rad.
        vs: (T, 7) joint velocities, rad/s.
    """

    times_s: Array
    qs: Array
    vs: Array

    def __post_init__(self) -> None:
        count = len(self.times_s)
        if count < 2 or self.qs.shape != (count, 7) or self.vs.shape != (count, 7):
            raise ValueError(
                f"times {self.times_s.shape}, qs {self.qs.shape}, vs {self.vs.shape}; expected "
                "(T,), (T, 7), (T, 7) with T >= 2"
            )
        if self.times_s[0] != 0.0 or np.any(np.diff(self.times_s) <= 0.0):
            raise ValueError("times_s must ascend from 0")

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1])


@dataclass(frozen=True)
class Segment:
    """One piece of a plan, executed without a pause.

    Attributes:
        name: what it does.
        trajectory: of the arm (at rest in CLOSE and OPEN).
        opening_start_m, opening_end_m: commanded distance between the pads, ramped linearly over
            the segment; below 0 the force limit acts.
        force_n: limit of the gripper's force.
        holding: whether the object is in the hand.
        allowed_contacts: the contacts it declares.
        stop_on_contact: whether the arm stops where it feels the object touch something.
        held_width_m: expected width of what is between the pads, where they stop; 0 for nothing.
    """

    name: SegmentName
    trajectory: JointTrajectory
    opening_start_m: float
    opening_end_m: float
    force_n: float
    holding: bool
    allowed_contacts: frozenset[AllowedContact] = frozenset()
    stop_on_contact: bool = False
    held_width_m: float = 0.0

    @property
    def openings_m(self) -> tuple[float, float]:
        """Expected distances between the pads at the start and at the end."""
        start, end = self.opening_start_m, self.opening_end_m
        return max(start, self.held_width_m), max(end, self.held_width_m)

    def opening_at_m(self, share: float) -> float:
        """Return the opening that is commanded when `share` of the segment's time is over."""
        return self.opening_start_m + share * (self.opening_end_m - self.opening_start_m)


def rows_of(segments: Sequence[Segment]) -> list[PlanRow]:
    """Return what the robot is told over the segments, one command every 10 ms."""
    rows: list[PlanRow] = []
    for segment in segments:
        trajectory = segment.trajectory
        for time_s, q, v in zip(trajectory.times_s, trajectory.qs, trajectory.vs, strict=True):
            opening_m = segment.opening_at_m(float(time_s) / trajectory.duration_s)
            now_s, numbers = round(SAMPLE_S * len(rows), 6), (tuple(q.tolist()), tuple(v.tolist()))
            rows.append(PlanRow(now_s, *numbers, opening_m, segment.force_n, str(segment.name)))
    return rows


@dataclass(frozen=True)
class Plan:
    """A pick and place as named segments, each starting where the last one ends.

    ========  =======================================================================  =======
    segment   what it does                                                             holding
    ========  =======================================================================  =======
    TRANSIT   from `q_start` to before the grasp                                       no
    APPROACH  straight on until the pads are around the object                         no
    CLOSE     at rest, the opening to below 0                                          no
    LIFT      off the table                                                            yes
    TRANSFER  to before the goal                                                       yes
    INSERT    once or more: to the goal, and down by feel (`stop_on_contact`)          yes
    OPEN      at rest                                                                  no
    RETREAT   straight back, slowly (`timing.RETREATING` in `planning.motion`)            no
    TRANSIT   away from the object; home (q_home) where the subgoal wants that         no
    ========  =======================================================================  =======

    All are there, in this order, but for the last TRANSIT where the subgoal does without
    (`Subgoal.goes_home`), and for the first four where the object is in the hand already.  Recovery
    drives LIFT and APPROACH back to put an object down; `planning.execution.faults` has the forces
    that each may feel, and takes an opening that changes by more than 2 mm in TRANSFER and INSERT
    for a slip.  `planning.checking.plan_contract` checks segments, poses, start and goal.

    Attributes:
        subgoal: what it is for.
        segments: in order of execution.
        X_WGrasp: (4, 4) gripper pose at CLOSE; at `q_start` where the object is in the hand.
        X_WGplace: (4, 4) gripper pose at OPEN, lowered all the way; where contact stops the
            lowering earlier, the hand opens higher.
        X_WObject: (4, 4) pose of the frame that is placed, of the subgoal's task, before the pick.
        X_WGoal: (4, 4) pose of the same frame when the gripper is at X_WGplace.
        statistics: counts and seconds of the search, for reports.
    """

    subgoal: Subgoal
    segments: tuple[Segment, ...]
    X_WGrasp: Array
    X_WGplace: Array
    X_WObject: Array
    X_WGoal: Array
    statistics: Mapping[str, float] = field(default_factory=dict)

    def export(self, path: str | Path) -> None:
        """Write the motion, one command every 10 ms, as CSV or JSON, by the file's suffix.

        `planning.plan_rows` tells what is in the file.  Where and how the arm stops by feel
        (`Segment.stop_on_contact`) is left to who follows it.

        Raises MotionFileError where the suffix is neither.
        """
        export_rows(Path(path), rows_of(self.segments))

    @property
    def pick(self) -> tuple[Segment, ...]:
        """The segments up to the lifted object; none where it was in the hand already."""
        return self.segments[: self._placing_from]

    @property
    def place(self) -> tuple[Segment, ...]:
        """The segments from there on."""
        return self.segments[self._placing_from :]

    @property
    def _placing_from(self) -> int:
        names = [segment.name for segment in self.segments]
        if SegmentName.TRANSFER not in names:
            raise ValueError(
                f"the plan's segments are {[str(name) for name in names]}; expected "
                f"{SegmentName.TRANSFER!s} where the placing begins"
            )
        return names.index(SegmentName.TRANSFER)


class Stage(StrEnum):
    """Where a trial can fail.

    CHECK: an independent check found that a plan must not be executed.
    ERROR: simulator, detector or planner raised, crashed, or took too long; the record has the
    traceback of what was raised.
    """

    PERCEPTION = "perception"
    PLANNING = "planning"
    GRASP = "grasp"
    TRANSPORT = "transport"
    PLACEMENT = "placement"
    CHECK = "refused by the checker"
    ERROR = "error"


@dataclass(frozen=True)
class PlanFailure:
    """No plan: the stage and a reason that says what was rejected by what."""

    stage: Stage
    reason: str
    statistics: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class PlanningProblem:
    """Everything a planner may know.

    Attributes:
        subgoal: what to plan for.
        pose_sets: from a detector, by their tasks' names, at least those of `subgoal.tasks`.
        p_WPs: (N, 3) perceived cloud of the object, metres in W: all that the cameras show of it,
            thinned in problems from files.
        q_start: (7,) joint angles at the start, rad.
        layout: of the static station.
        held_width_m: measured distance between the pads that hold the object already, its pose sets
            and cloud being those of the object in the hand at `q_start`; None where it lies.
        X_WGfailed: (F, 4, 4) grasps (releases, where the object is held) that failed before and
            shall not be tried again, nor any like them: `planning.geometry.modes.away_from` says
            which.
        p_WObstacles: (O, 3) points of everything else in view, metres in W: neither the robot nor
            what it holds may touch them.
    """

    subgoal: Subgoal
    pose_sets: PoseSets
    p_WPs: Array
    q_start: Array
    layout: Layout
    held_width_m: float | None = None
    X_WGfailed: Array = field(default_factory=lambda: np.empty((0, 4, 4)))
    p_WObstacles: Array = field(default_factory=lambda: np.empty((0, 3)))

    def __post_init__(self) -> None:
        require_numbers(self)
        wanted = [task.name for task in self.subgoal.tasks]
        missing = [name for name in wanted if name not in self.pose_sets]
        if missing:
            raise ValueError(f"{self.subgoal} needs pose sets for {wanted}; missing {missing}")
        if np.shape(self.q_start) != (7,):
            raise ValueError(f"q_start has shape {np.shape(self.q_start)}; expected (7,)")
        if np.shape(self.X_WGfailed)[1:] != (4, 4):
            raise ValueError(
                f"X_WGfailed has shape {np.shape(self.X_WGfailed)}; expected (F, 4, 4)"
            )
        if np.shape(self.p_WObstacles)[1:] != (3,):
            raise ValueError(
                f"p_WObstacles has shape {np.shape(self.p_WObstacles)}; expected (O, 3)"
            )
