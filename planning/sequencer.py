"""From a task to its end: perceive, plan, execute; where no hang can be planned, reorient first."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planning.executor import ExecutionResult, Executor
from planning.planner import Planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage, Subgoal
from split_drake.layout import Layout
from split_drake.pose_set import PoseSet, PoseTask
from split_drake.scene import EmptySceneError, Scene

PoseSets = Mapping[PoseTask, PoseSet]
Perceive = Callable[[Sequence[PoseTask]], tuple[Scene, PoseSets]]

# How often an object is stood upright before hanging it is given up.
MAX_REORIENTATIONS = 1


@dataclass(frozen=True)
class Perception:
    """What was seen at one moment.

    Attributes:
        scene: the cloud and its views.
        pose_sets: found in it.
        duration_s: wall time that it took.
    """

    scene: Scene
    pose_sets: PoseSets
    duration_s: float


@dataclass(frozen=True)
class Attempt:
    """One subgoal, planned and, where there is a plan, executed.

    Attributes:
        subgoal: that was tried.
        perception: that it was planned from; two attempts may share one.
        outcome: the plan, or why there is none.
        execution: how the plan went; None where there is none.
        planning_s, execution_s: wall time.
    """

    subgoal: Subgoal
    perception: Perception
    outcome: Plan | PlanFailure
    execution: ExecutionResult | None
    planning_s: float
    execution_s: float


@dataclass(frozen=True)
class SequenceResult:
    """All attempts at a task.

    Attributes:
        attempts: in their order.
        stage: where the task failed; None where the last plan was executed to its end, which says
            nothing yet about whether the object is where it should be.
        reason: of the failure; empty where there is none.
        perception_s: wall time of all perceptions.
    """

    attempts: tuple[Attempt, ...]
    stage: Stage | None
    reason: str
    perception_s: float

    @property
    def completed(self) -> bool:
        return self.stage is None

    @property
    def planning_s(self) -> float:
        return sum(attempt.planning_s for attempt in self.attempts)

    @property
    def execution_s(self) -> float:
        return sum(attempt.execution_s for attempt in self.attempts)


class Sequencer:
    """Reaches a task by one plan, or by standing the object upright first.

    Args:
        planner: for every subgoal.
        perceive: looks at the workspace and detects the given tasks' pose sets.
        executor: of plans.
        layout: of the static station.
    """

    def __init__(
        self, planner: Planner, perceive: Perceive, executor: Executor, layout: Layout | None = None
    ) -> None:
        self._planner = planner
        self._perceive = perceive
        self._executor = executor
        self._layout = layout or Layout()

    def run(self, task: Subgoal, rng: np.random.Generator) -> SequenceResult:
        """Try to reach the task, and return everything that was tried.

        The robot is expected to be out of the cameras' sight.
        """
        return _Run(self, task, rng).run()

    def look(self, task: Subgoal) -> Perception:
        """Perceive what the task, and standing the object upright before it, need."""
        tasks = tuple(dict.fromkeys((*task.tasks, *Subgoal.REORIENT.tasks)))
        started = time.monotonic()
        scene, pose_sets = self._perceive(tasks)
        return Perception(scene, pose_sets, time.monotonic() - started)

    def attempt(
        self, subgoal: Subgoal, perception: Perception, rng: np.random.Generator
    ) -> Attempt:
        """Plan a subgoal and execute the plan."""
        problem = PlanningProblem(
            subgoal,
            perception.pose_sets,
            perception.scene.p_WPs,
            self._executor.robot.q,
            self._layout,
        )
        started = time.monotonic()
        outcome = self._planner.plan(problem, rng)
        planned = time.monotonic()
        execution = self._executor.run(outcome) if isinstance(outcome, Plan) else None
        executed = time.monotonic()
        return Attempt(
            subgoal, perception, outcome, execution, planned - started, executed - planned
        )


class _Run:
    """The state of one sequence."""

    def __init__(self, sequencer: Sequencer, task: Subgoal, rng: np.random.Generator) -> None:
        self._sequencer = sequencer
        self._task = task
        self._rng = rng
        self._attempts: list[Attempt] = []
        self._perception_s = 0.0

    def run(self) -> SequenceResult:
        while True:
            try:
                perception = self._sequencer.look(self._task)
            except EmptySceneError as error:
                return self._result(Stage.PERCEPTION, str(error))
            self._perception_s += perception.duration_s
            failure = self._try(self._task, perception)
            if failure is None or not self._may_reorient():
                return self._ended(failure)
            no_upright = self._try(Subgoal.REORIENT, perception)
            if no_upright is not None:
                reason = f"hang: {failure.reason}; reorient: {no_upright.reason}"
                return self._result(no_upright.stage, reason)
            if not self._last_execution().completed:
                return self._ended(None)

    def _try(self, subgoal: Subgoal, perception: Perception) -> PlanFailure | None:
        """Plan and execute a subgoal; return why there is no plan, or None where there was one."""
        attempt = self._sequencer.attempt(subgoal, perception, self._rng)
        self._attempts.append(attempt)
        return attempt.outcome if isinstance(attempt.outcome, PlanFailure) else None

    def _may_reorient(self) -> bool:
        done = sum(attempt.subgoal is Subgoal.REORIENT for attempt in self._attempts)
        return self._task is Subgoal.HANG and done < MAX_REORIENTATIONS

    def _last_execution(self) -> ExecutionResult:
        execution = self._attempts[-1].execution
        if execution is None:
            raise RuntimeError("the last attempt was not executed")
        return execution

    def _ended(self, failure: PlanFailure | None) -> SequenceResult:
        """Return the result of a task that ends with the last attempt."""
        if failure is not None:
            return self._result(failure.stage, failure.reason)
        execution = self._last_execution()
        return self._result(execution.stage, execution.reason)

    def _result(self, stage: Stage | None, reason: str) -> SequenceResult:
        return SequenceResult(tuple(self._attempts), stage, reason, self._perception_s)
