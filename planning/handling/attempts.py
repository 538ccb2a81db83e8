"""What was tried at a task, in which order, and how it ended."""

from dataclasses import dataclass
from typing import Self

from planning.execution.executor import ExecutionResult
from planning.handling.held_view import HeldView
from planning.problem import Plan, PlanFailure, Stage
from planning.subgoal import Subgoal
from split_drake.bad_input import require_numbers
from split_drake.pose_set import PoseSets
from split_drake.poses import Array
from split_drake.scene import Scene


@dataclass(frozen=True)
class AttemptLimits:
    """How much is tried before a task is given up.

    Attributes:
        picks: how often the object is taken in vain; at least 1.
        placements: ways of placing that are tried out of one hand; at least 1.
        firsts: how often each subgoal before the one that is asked for is reached (an object stood
            upright before it is hung) before that is given up; 0 for never.
        looks: perceptions in a row from which no plan came.
        ways_out: that are tried out of an object which the open hand is caught on.
        held_views: whether what was lifted is looked at, and placed as it lies in the hand.
        lowers_on: whether what is to be let go is lowered on where nothing was felt.
        looks_after: whether a look tells if what was let go above the table has fallen onto it.

    Raises ValueError where one of them is too small.
    """

    picks: int = 4
    placements: int = 3
    firsts: int = 1
    looks: int = 2
    ways_out: int = 3
    held_views: bool = True
    lowers_on: bool = True
    looks_after: bool = True

    @classmethod
    def without_feedback(cls) -> Self:
        """Return limits under which plans are executed as they are, and nothing is tried twice."""
        return cls(
            picks=1,
            placements=1,
            looks=1,
            ways_out=0,
            held_views=False,
            lowers_on=False,
            looks_after=False,
        )

    def __post_init__(self) -> None:
        require_numbers(self)
        leasts = {"picks": 1, "placements": 1, "firsts": 0, "looks": 1, "ways_out": 0}
        for name, least in leasts.items():
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least {least}")


@dataclass(frozen=True)
class Perception:
    """What was seen at one moment.

    Attributes:
        scene: the cloud and its views.
        pose_sets: of the one object that is dealt with.
        p_WPs: (N, 3) the cloud of that object, metres in W.
        p_WObstacles: (O, 3) that of all else.
        in_view: how many objects there are.
        duration_s: wall time that it took.
    """

    scene: Scene
    pose_sets: PoseSets
    p_WPs: Array
    p_WObstacles: Array
    in_view: int
    duration_s: float


@dataclass(frozen=True)
class Attempt:
    """One subgoal, planned and, where there is a plan, executed.

    Attributes:
        subgoal: that was tried.
        perception: that it was planned from; several attempts may share one.
        outcome: the plan, or why there is none.
        execution: how the plan went, to the lifted object where another attempt goes on from there;
            None where there is no plan.
        planning_s: wall time of the planner.
        held: how the object was seen to lie in the hand, before the attempt where its plan starts
            from there, else after the lift; None where nothing was lifted.
        recovery: what the robot did after a failure; empty where it did nothing.
    """

    subgoal: Subgoal
    perception: Perception
    outcome: Plan | PlanFailure
    execution: ExecutionResult | None
    planning_s: float
    held: HeldView | None = None
    recovery: str = ""

    @property
    def failure(self) -> tuple[Stage | None, str]:
        """The stage that failed and why; (None, "") where the attempt was executed to its end."""
        if isinstance(self.outcome, PlanFailure):
            return self.outcome.stage, self.outcome.reason
        if self.execution is None:
            raise ValueError("a plan that was not executed has no outcome yet")
        return self.execution.stage, self.execution.reason


@dataclass(frozen=True)
class SequenceResult:
    """All attempts at a task.

    Attributes:
        attempts: in their order.
        stage: where the task failed; None where the last plan was executed to its end, which says
            nothing yet about whether the object is where it should be.
        reason: of the failure; empty where there is none.
        perception_s: wall time of all perceptions.
        execution_s: wall time of all executions, with all recovery after them.
    """

    attempts: tuple[Attempt, ...]
    stage: Stage | None
    reason: str
    perception_s: float
    execution_s: float

    @property
    def completed(self) -> bool:
        return self.stage is None

    @property
    def planning_s(self) -> float:
        return sum(attempt.planning_s for attempt in self.attempts)
