"""From a subgoal to its end: perceive, plan, execute; where it cannot be planned, others first."""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from planning.execution.executor import Executor
from planning.geometry.focus import focus_on_one
from planning.geometry.perceived import best_upright
from planning.handling.attempts import Attempt, AttemptLimits, Perception, SequenceResult
from planning.handling.handler import Handler
from planning.handling.timed_planning import TimedOutcome, plan_timed
from planning.planner import Planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage
from planning.subgoal import Subgoal
from split_drake.pose_set import PoseSets
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


class Sequencer:
    """Reaches a subgoal by one plan or by several, other subgoals before it where it must.

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
        layout: Layout,
        limits: AttemptLimits | None = None,
    ) -> None:
        self.limits = limits or AttemptLimits()
        self._planner = planner
        self._perceive = perceive
        self._executor = executor
        self._layout = layout

    def reach(self, goal: Subgoal, rng: np.random.Generator) -> SequenceResult:
        """Try to reach the subgoal, and return everything that was tried.

        The robot is expected to be out of the cameras' sight.
        """
        return _Sequence(self, goal, rng).carry_out()

    def look(self, goal: Subgoal, again: bool = False) -> Perception:
        """Perceive what the subgoal, and those before it, need, of one object of those in view.

        `again`: whether what was perceived last led nowhere.
        """
        started = time.monotonic()
        scene, pose_sets = self._perceive(goal.perceived_tasks, again)
        focus = focus_on_one(scene.p_WPs, pose_sets, goal.tasks)
        return Perception(
            scene,
            focus.pose_sets,
            focus.p_WPs,
            focus.p_WObstacles,
            focus.in_view,
            time.monotonic() - started,
        )

    def plan(
        self,
        subgoal: Subgoal,
        perception: Perception,
        X_WGfailed: Array,
        rng: np.random.Generator,
    ) -> TimedOutcome:
        """Plan a subgoal, without grasps that failed (F, 4, 4)."""
        problem = PlanningProblem(
            subgoal,
            perception.pose_sets,
            perception.p_WPs,
            self._executor.robot.q,
            self._layout,
            X_WGfailed=X_WGfailed,
            p_WObstacles=perception.p_WObstacles,
        )
        found = plan_timed(self._planner, problem, rng)
        if isinstance(found.outcome, Plan) and found.outcome.subgoal != subgoal:
            raise ValueError(
                f"a plan to {found.outcome.subgoal} was made where one to {subgoal} was due"
            )
        return found

    def handler(self) -> Handler:
        """Return what executes this sequencer's plans."""
        return Handler(self._planner, self._executor, self._layout, self.limits)


class _Sequence:
    """The state of one sequence."""

    def __init__(self, sequencer: Sequencer, goal: Subgoal, rng: np.random.Generator) -> None:
        self._sequencer = sequencer
        self._limits = sequencer.limits
        self._goal = goal
        self._rng = rng
        self._attempts: list[Attempt] = []
        self._failed: list[tuple[Array | None, Array]] = []
        self._perception_s, self._execution_s = 0.0, 0.0
        self._picks = 0
        self._firsts: Counter[str] = Counter()  # subgoals before the goal, by how often reached

    def carry_out(self) -> SequenceResult:
        looks = 0
        while True:
            try:
                perception = self._look()
            except EmptySceneError as error:
                return self._gone(str(error))
            if self._reached(perception):
                return self._result(None, "")
            planned = self._plan(perception)
            if isinstance(planned, PlanFailure):
                looks += 1
                if looks >= self._limits.looks:
                    return self._result(planned.stage, planned.reason)
                continue
            looks = 0
            end = self._execute(perception, *planned)
            if end is not None:
                return end

    def _gone(self, reason: str) -> SequenceResult:
        """Return the result where the object is out of sight, by what made it so if known."""
        stage, failed = self._attempts[-1].failure if self._attempts else (None, "")
        return self._result(
            stage or Stage.PERCEPTION, "; then ".join(filter(None, (failed, reason)))
        )

    def _look(self) -> Perception:
        led_nowhere = bool(self._attempts) and self._attempts[-1].failure[0] is not None
        perception = self._sequencer.look(self._goal, again=led_nowhere)
        self._perception_s += perception.duration_s
        return perception

    def _reached(self, perception: Perception) -> bool:
        """Return whether the last plan executed was to the goal, and that seems to be reached.

        After the last pick that is granted, it is taken to be.
        """
        seems_reached = self._goal.seems_reached
        if seems_reached is None or not self._goal_executed_last():
            return False
        reached = seems_reached(perception.pose_sets[self._goal.task.name])
        return reached or self._picks >= self._limits.picks

    def _goal_executed_last(self) -> bool:
        """Return whether the last execution was of a plan to the goal, and went to its end."""
        for attempt in reversed(self._attempts):
            if attempt.execution is not None:
                return attempt.subgoal == self._goal and attempt.execution.completed
        return False

    def _plan(self, perception: Perception) -> tuple[Plan, float] | PlanFailure:
        """Return a plan for the goal, or else for what comes before it, and the time it took."""
        X_WGfailed = self._failed_grasps(best_upright(perception.pose_sets))
        failures: dict[str, PlanFailure] = {}
        for subgoal in self._subgoals():
            found = self._sequencer.plan(subgoal, perception, X_WGfailed, self._rng)
            if isinstance(found.outcome, Plan):
                return found.outcome, found.took_s
            self._attempts.append(Attempt(subgoal, perception, found.outcome, None, found.took_s))
            failures[subgoal.name] = found.outcome
        last = list(failures.values())[-1]
        if len(failures) == 1:
            return last
        reason = "; ".join(f"{name}: {failure.reason}" for name, failure in failures.items())
        return replace(last, reason=reason)

    def _failed_grasps(self, X_WU: Array | None) -> Array:
        """Return the grasps (F, 4, 4) that failed; they moved with the object if that was seen."""
        found = [
            X_WG if X_WU is None or X_WUThen is None else X_WU @ invert_pose(X_WUThen) @ X_WG
            for X_WUThen, X_WG in self._failed
        ]
        return np.reshape(found, (-1, 4, 4))

    def _subgoals(self) -> tuple[Subgoal, ...]:
        """Return what may be planned for, in order of preference."""
        _, *before = self._goal.chain
        return (self._goal, *(s for s in before if self._firsts[s.name] < self._limits.firsts))

    def _execute(
        self, perception: Perception, plan: Plan, planning_s: float
    ) -> SequenceResult | None:
        """Execute a plan; return how the task ended, or None where it is to be gone on with."""
        started = time.monotonic()
        outcome = self._sequencer.handler().handle(plan, perception, planning_s, self._rng)
        replanning_s = sum(attempt.planning_s for attempt in outcome.attempts) - planning_s
        self._execution_s += time.monotonic() - started - replanning_s
        self._attempts.extend(outcome.attempts)
        stage, reason = outcome.attempts[-1].failure
        if stage is None:
            if plan.subgoal == self._goal and self._goal.seems_reached is None:
                return self._result(None, "")
            if plan.subgoal == self._goal:
                # Whether it is reached, the next look says; what follows is another try at it.
                self._picks += 1
            else:
                self._firsts[plan.subgoal.name] += 1
            return None
        self._picks += 1
        self._failed.append((best_upright(perception.pose_sets), plan.X_WGrasp))
        if outcome.home and self._picks < self._limits.picks:
            return None
        return self._result(stage, reason)

    def _result(self, stage: Stage | None, reason: str) -> SequenceResult:
        return SequenceResult(
            tuple(self._attempts), stage, reason, self._perception_s, self._execution_s
        )
