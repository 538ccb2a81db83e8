"""From a task to its end: perceive, plan, handle; where no hang can be planned, reorient first."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from planning.execution.executor import Executor
from planning.handling.attempts import Attempt, AttemptLimits, Perception, PoseSets, SequenceResult
from planning.handling.handler import Handler
from planning.planner import Planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage, Subgoal
from split_drake.pose_task import PoseTask
from split_drake.poses import Array, invert_pose
from split_drake.scene import EmptySceneError, Scene
from split_drake.station.layout import Layout


class Perceive(Protocol):
    """Looks at the workspace and detects pose sets."""

    def __call__(self, tasks: Sequence[PoseTask], again: bool) -> tuple[Scene, PoseSets]:
        """Return the scene and the tasks' pose sets.

        Args:
            tasks: whose pose sets are wanted.
            again: whether what was found last time led nowhere, so that grasps of other kinds are
                worth more than the best ones.
        """
        ...


# An object that was stood upright is taken to stand where it is seen tilted by no more than this:
# some mugs lean on their handles for good.
STANDING_TILT_RAD = np.radians(15.0)


class Sequencer:
    """Reaches a task by one plan or by several, standing the object upright first where it must.

    Args:
        planner: for every subgoal.
        perceive: looks at the workspace.
        executor: of plans.
        layout: of the static station.
        limits: how much is tried.
    """

    def __init__(
        self,
        planner: Planner,
        perceive: Perceive,
        executor: Executor,
        layout: Layout | None = None,
        limits: AttemptLimits | None = None,
    ) -> None:
        self.limits = limits or AttemptLimits()
        self._planner = planner
        self._perceive = perceive
        self._executor = executor
        self._layout = layout or Layout()

    def run(self, task: Subgoal, rng: np.random.Generator) -> SequenceResult:
        """Try to reach the task, and return everything that was tried.

        The robot is expected to be out of the cameras' sight.
        """
        return _Run(self, task, rng).run()

    def look(self, task: Subgoal, again: bool = False) -> Perception:
        """Perceive what the task, and standing the object upright before it, need.

        `again`: whether what was perceived last led nowhere.
        """
        tasks = tuple(dict.fromkeys((*task.tasks, *Subgoal.REORIENT.tasks)))
        started = time.monotonic()
        scene, pose_sets = self._perceive(tasks, again)
        return Perception(scene, pose_sets, time.monotonic() - started)

    def plan(
        self,
        subgoal: Subgoal,
        perception: Perception,
        X_WGfailed: Array,
        rng: np.random.Generator,
    ) -> tuple[Plan | PlanFailure, float]:
        """Plan a subgoal, without grasps that failed (F, 4, 4); return it and the time."""
        problem = PlanningProblem(
            subgoal,
            perception.pose_sets,
            perception.scene.p_WPs,
            self._executor.robot.q,
            self._layout,
            X_WGfailed=X_WGfailed,
        )
        started = time.monotonic()
        outcome = self._planner.plan(problem, rng)
        if isinstance(outcome, Plan) and outcome.subgoal is not subgoal:
            raise ValueError(f"a plan to {outcome.subgoal} was made where one to {subgoal} was due")
        return outcome, time.monotonic() - started

    def handler(self) -> Handler:
        """Return what executes this sequencer's plans."""
        return Handler(self._planner, self._executor, self._layout, self.limits)


class _Run:
    """The state of one sequence."""

    def __init__(self, sequencer: Sequencer, task: Subgoal, rng: np.random.Generator) -> None:
        self._sequencer = sequencer
        self._limits = sequencer.limits
        self._task = task
        self._rng = rng
        self._attempts: list[Attempt] = []
        self._failed: list[tuple[Array | None, Array]] = []
        self._perception_s = 0.0
        self._picks, self._reoriented = 0, 0

    def run(self) -> SequenceResult:
        looks = 0
        while True:
            try:
                perception = self._look()
            except EmptySceneError as error:
                return self._gone(str(error))
            if self._stands(perception):
                return self._result(None, "")
            planned = self._plan(perception)
            if isinstance(planned, PlanFailure):
                looks += 1
                if looks >= self._limits.looks:
                    return self._result(planned.stage, planned.reason)
                continue
            looks = 0
            end = self._handle(perception, *planned)
            if end is not None:
                return end

    def _gone(self, reason: str) -> SequenceResult:
        """Return the result of a task whose object is out of sight, by what made it so if known."""
        stage, failed = self._attempts[-1].failure if self._attempts else (None, "")
        return self._result(
            stage or Stage.PERCEPTION, "; then ".join(filter(None, (failed, reason)))
        )

    def _look(self) -> Perception:
        led_nowhere = bool(self._attempts) and self._attempts[-1].failure[0] is not None
        perception = self._sequencer.look(self._task, again=led_nowhere)
        self._perception_s += perception.duration_s
        return perception

    def _stands(self, perception: Perception) -> bool:
        """Return whether the task was to stand the object upright, and it was and seems to be.

        After the last pick that is granted, it is taken to stand.
        """
        executed = [each.execution for each in self._attempts if each.execution is not None]
        if self._task is Subgoal.HANG or not executed or not executed[-1].completed:
            return False
        X_WU = _X_WU(perception)
        tilted = X_WU is not None and X_WU[2, 2] < np.cos(STANDING_TILT_RAD)
        return not tilted or self._picks >= self._limits.picks

    def _plan(self, perception: Perception) -> tuple[Plan, float] | PlanFailure:
        """Return a plan for the task, or else for a reorientation, and the time that it took."""
        X_WGfailed = self._failed_grasps(_X_WU(perception))
        failures: dict[Subgoal, PlanFailure] = {}
        for subgoal in self._subgoals():
            outcome, took_s = self._sequencer.plan(subgoal, perception, X_WGfailed, self._rng)
            if isinstance(outcome, Plan):
                return outcome, took_s
            self._attempts.append(Attempt(subgoal, perception, outcome, None, took_s, 0.0))
            failures[subgoal] = outcome
        if len(failures) == 1:
            return failures[subgoal]
        reason = "; ".join(f"{subgoal}: {failure.reason}" for subgoal, failure in failures.items())
        return replace(failures[subgoal], reason=reason)

    def _failed_grasps(self, X_WU: Array | None) -> Array:
        """Return the grasps (F, 4, 4) that failed; they moved with the object if that was seen."""
        found = [
            X_WG if X_WU is None or X_WUThen is None else X_WU @ invert_pose(X_WUThen) @ X_WG
            for X_WUThen, X_WG in self._failed
        ]
        return np.reshape(found, (-1, 4, 4))

    def _subgoals(self) -> tuple[Subgoal, ...]:
        """Return what may be planned for, in order of preference."""
        if self._task is Subgoal.HANG and self._reoriented < self._limits.reorientations:
            return (Subgoal.HANG, Subgoal.REORIENT)
        return (self._task,)

    def _handle(
        self, perception: Perception, plan: Plan, planning_s: float
    ) -> SequenceResult | None:
        """Execute a plan; return how the task ended, or None where it is to be gone on with."""
        handled = self._sequencer.handler().run(plan, perception, planning_s, self._rng)
        self._attempts.extend(handled.attempts)
        stage, reason = handled.attempts[-1].failure
        if stage is None:
            if plan.subgoal is Subgoal.HANG:
                return self._result(None, "")
            self._reoriented += 1
            # Where the object is to stand, what follows is another try at the same.
            self._picks += self._task is Subgoal.REORIENT
            return None
        self._picks += 1
        self._failed.append((_X_WU(perception), plan.X_WGrasp))
        if handled.home and self._picks < self._limits.picks:
            return None
        return self._result(stage, reason)

    def _result(self, stage: Stage | None, reason: str) -> SequenceResult:
        return SequenceResult(tuple(self._attempts), stage, reason, self._perception_s)


def _X_WU(perception: Perception) -> Array | None:
    """Return the best upright pose (4, 4), which failed grasps move with; None if there is none."""
    poses = perception.pose_sets[PoseTask.UPRIGHT]
    return poses.X_WPs[0] if len(poses) else None
