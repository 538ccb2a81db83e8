"""One pick with feedback: what is in the hand is looked at, and placed as it lies there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planning.execution.executor import ExecutionResult, Executor, joined
from planning.execution.faults import Fault
from planning.handling.attempts import Attempt, AttemptLimits, Perception
from planning.handling.fallen import fallen_object
from planning.handling.held_view import HeldView, view_held
from planning.handling.recovery import Recovery
from planning.handling.timed_planning import plan_timed
from planning.planner import Planner
from planning.problem import (
    Plan,
    PlanFailure,
    PlanningProblem,
    Segment,
    SegmentName,
    Stage,
)
from split_drake.poses import Array, invert_pose, rotation_error_rad, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.sensing.table_noise import above_table_noise
from split_drake.station.layout import Layout

# A plan is kept while the frame that it places has moved in the hand by no more than this.
KEPT_SHIFT_M = 0.003
KEPT_TURN_RAD = np.radians(3.0)
# Where nothing can be planned from what was seen, one is executed that is off by no more than this:
# most objects come off well with that.
BEARABLE_SHIFT_M = 0.008
BEARABLE_TURN_RAD = np.radians(10.0)
# An object that turned by more while it was lifted goes on turning: of six mugs that were carried
# so, three missed the peg or fell from it, and of 458 others eleven.
MAX_CARRIED_TURN_RAD = np.radians(17.0)

_NOTHING = ExecutionResult(True, ())
_NO_WAY_HOME, _CAUGHT = "no way home was found", "the hand stayed caught"


@dataclass(frozen=True)
class PickOutcome:
    """What became of one pick.

    Attributes:
        attempts: in their order; the last one says how it ended.
        home: where that has failed, whether the robot is at home again with an empty hand.
    """

    attempts: tuple[Attempt, ...]
    home: bool


@dataclass(frozen=True)
class Handler:
    """Takes objects by plans, and places them by these or, where they fit no longer, by others.

    Attributes:
        planner: of what remains to be done with an object in the hand.
        executor: of the segments.
        layout: of the static station.
        limits: how much is tried.
    """

    planner: Planner
    executor: Executor
    layout: Layout
    limits: AttemptLimits

    def handle(
        self, plan: Plan, perception: Perception, planning_s: float, rng: np.random.Generator
    ) -> PickOutcome:
        """Execute a plan that was made from a perception in `planning_s`."""
        return _Handling(self, plan, perception, planning_s, rng).carry_out()


class _Handling:
    """The state of one pick and of what follows it.

    E is the gripper's frame relative to the object where it was to be taken, as in `HeldView`.
    """

    def __init__(
        self,
        handler: Handler,
        plan: Plan,
        perception: Perception,
        planning_s: float,
        rng: np.random.Generator,
    ) -> None:
        self._handler = handler
        self._executor = handler.executor
        self._recovery = Recovery(handler.executor, handler.layout, handler.limits.ways_out)
        self._taking, self._plan = plan, plan
        self._perception = perception
        self._rng = rng
        self._planning_s = planning_s
        self._X_GEplanned = np.eye(4)
        self._held: HeldView | None = None
        self._failures = 0
        self._X_WGblocked: list[Array] = []
        self._attempts: list[Attempt] = []

    def carry_out(self) -> PickOutcome:
        done = self._executor.execute(self._plan.pick)
        if not done.completed:
            return self._lost(self._plan.pick, done, done)
        while True:
            self._held = held = self._look()
            if held.elsewhere:
                return self._not_as_known(done, held.rejected)
            if held.turn_rad > MAX_CARRIED_TURN_RAD:
                turned = f"it turned by {np.degrees(held.turn_rad):.0f} degrees in the hand"
                return self._not_as_known(done, turned)
            if self._failures or not self._as_planned(held, KEPT_SHIFT_M, KEPT_TURN_RAD):
                if done.logs:
                    self._note(self._plan, done, "planned anew from how it lay in the hand")
                done = _NOTHING
                if not self._replan(held):
                    return self._put_down()
            placed = self._place()
            if placed.fault is Fault.CAUGHT:
                return self._eased_out(placed, done)
            whole, done = replace(placed, logs=done.logs + placed.logs), _NOTHING
            if placed.fault is Fault.EMPTY:
                return self._lost(self._plan.place, placed, whole)
            if placed.completed:
                return self._let_go(whole)
            self._note(self._plan, whole)
            self._failures += 1
            if placed.stage is Stage.PLACEMENT:
                self._X_WGblocked.append(self._plan.X_WGplace)
            if self._recovery.back_out(self._plan.place, placed).fault is Fault.EMPTY:
                return self._ended("the object was lost on the way back", free=True)
            if self._failures >= self._handler.limits.placements:
                return self._put_down()

    def _let_go(self, whole: ExecutionResult) -> PickOutcome:
        """Note an attempt that went to its end, and whether the object stayed where it was put."""
        looked = self._looked_after(whole)
        self._note(self._plan, looked)
        if looked.completed:
            return PickOutcome(tuple(self._attempts), home=False)
        return self._ended("left it there", free=True)

    def _looked_after(self, done: ExecutionResult) -> ExecutionResult:
        """Return an execution that went to its end; one that failed if the object fell after it."""
        if not self._handler.limits.looks_after:
            return done
        robot, layout = self._executor.robot, self._handler.layout
        fallen = fallen_object(robot, layout, self._taking, self._perception)
        if fallen is None:
            return done
        reason = f"the object fell: something lies at ({fallen[0]:.2f}, {fallen[1]:.2f}) m now"
        return replace(done, completed=False, stage=Stage.PLACEMENT, reason=reason)

    def _place(self) -> ExecutionResult:
        """Execute the rest of the plan; what is let go is lowered on where nothing was felt.

        The logs are those of the plan's segments, one each.
        """
        segments = self._plan.place
        felt = [segment.holding and segment.stop_on_contact for segment in segments]
        if not any(felt) or not self._handler.limits.lowers_on:
            return self._executor.execute(segments)
        lowering = felt.index(True)
        done = self._executor.execute(segments[: lowering + 1])
        if done.completed and not done.logs[-1].stopped_by_contact:
            further = self._recovery.lower_on(segments[lowering])
            done = replace(further, logs=(*done.logs[:-1], joined(done.logs[-1], *further.logs)))
        if not done.completed:
            return done
        offset = self._executor.robot.q - segments[lowering].trajectory.qs[-1]
        rest = self._executor.execute(segments[lowering + 1 :], offset)
        return replace(rest, logs=done.logs + rest.logs)

    def _look(self) -> HeldView:
        """Measure how the object lies in the hand, where that is wanted."""
        known = np.eye(4) if self._held is None else self._held.X_GE
        if not self._handler.limits.held_views:
            return HeldView(known, rejected="not looked at")
        robot = self._executor.robot
        views = robot.capture()
        X_EW = invert_pose(self._taking.X_WGrasp)
        return view_held(
            views,
            robot.q,
            robot.opening_m,
            transform_points(X_EW, self._perception.p_WPs),
            above_table_noise(self._handler.layout.workspace, views).lowest_z_m,
            known,
            self._perception.p_WObstacles,
        )

    def _as_planned(self, held: HeldView, shift_m: float, turn_rad: float) -> bool:
        """Return whether what the plan places lies in the hand as it has it, within bounds."""
        X_EO = invert_pose(self._taking.X_WGrasp) @ self._taking.X_WObject
        X_GOseen, X_GOplanned = held.X_GE @ X_EO, self._X_GEplanned @ X_EO
        shift = np.linalg.norm(X_GOseen[:3, 3] - X_GOplanned[:3, 3])
        turn = rotation_error_rad(X_GOseen[:3, :3], X_GOplanned[:3, :3])
        return bool(shift <= shift_m and turn <= turn_rad)

    def _replan(self, held: HeldView) -> bool:
        """Plan the rest from what was seen in the hand; note a failure.

        Return whether there is a plan to go on with: a new one, or a bearable one.
        """
        found = plan_timed(self._handler.planner, self._problem(held), self._rng)
        outcome, self._planning_s = found.outcome, found.took_s
        if isinstance(outcome, Plan) and outcome.pick:
            begins = f"the plan for an object in the hand begins with {outcome.pick[0].name}"
            outcome = PlanFailure(Stage.PLANNING, f"{begins}; expected {SegmentName.TRANSFER}")
        if isinstance(outcome, Plan):
            self._plan, self._X_GEplanned = outcome, held.X_GE
            return True
        bears = not self._failures and self._as_planned(held, BEARABLE_SHIFT_M, BEARABLE_TURN_RAD)
        self._note(outcome, None, "placed by the first plan" if bears else "")
        return bears

    def _problem(self, held: HeldView) -> PlanningProblem:
        """Return the problem of the object in the hand: all that was perceived, moved there."""
        robot, perception = self._executor.robot, self._perception
        X_WG = gripper_pose(robot.q)
        X_WMoved = X_WG @ held.X_GE @ invert_pose(self._taking.X_WGrasp)
        return PlanningProblem(
            subgoal=self._taking.subgoal,
            pose_sets={name: s.moved(X_WMoved) for name, s in perception.pose_sets.items()},
            p_WPs=transform_points(X_WMoved, perception.p_WPs),
            q_start=robot.q,
            layout=self._handler.layout,
            held_width_m=robot.opening_m,
            X_WGfailed=np.reshape(self._X_WGblocked, (-1, 4, 4)),
            p_WObstacles=perception.p_WObstacles,
        )

    def _lost(
        self, segments: Sequence[Segment], execution: ExecutionResult, whole: ExecutionResult
    ) -> PickOutcome:
        """Note an attempt that ended with an empty hand, and draw back."""
        self._note(self._plan, whole)
        free = self._recovery.withdraw(segments, execution)
        return self._ended("drew back", free)

    def _eased_out(self, placed: ExecutionResult, before: ExecutionResult) -> PickOutcome:
        """Lead the hand out of what it let go of and is caught on, and note the attempt.

        The robot goes home where the rest of the plan would have led it there.
        """
        out = self._recovery.eased_out(self._plan.place, placed)
        recovery = "eased the hand out" if out.completed else _CAUGHT
        free = out.completed
        if free:
            out = self._looked_after(out)
        # It stays beside what hangs, which may swing, and nowhere else.
        to_go_home = free and (self._plan.subgoal.goes_home or not out.completed)
        home = to_go_home and self._go_home()
        if to_go_home and out.completed and not home:
            out = replace(out, completed=False, stage=Stage.PLACEMENT, reason=_NO_WAY_HOME)
        self._note(self._plan, replace(out, logs=before.logs + out.logs), recovery)
        return PickOutcome(tuple(self._attempts), home)

    def _not_as_known(self, done: ExecutionResult, seen: str) -> PickOutcome:
        """Note, where no failure says so already, what was seen of it, and put it down."""
        if not self._failures:
            reason = f"the object is not as it was taken: {seen}"
            turned = ExecutionResult(False, done.logs, Stage.GRASP, reason, Fault.SLIPPED)
            self._note(self._plan, turned)
        return self._put_down()

    def _put_down(self) -> PickOutcome:
        free = self._recovery.put_down(self._taking)
        return self._ended("put the object down", free)

    def _go_home(self) -> bool:
        return self._recovery.go_home(self._rng)

    def _note(
        self, outcome: Plan | PlanFailure, execution: ExecutionResult | None, recovery: str = ""
    ) -> None:
        """Add an attempt; the planner's time counts once."""
        of = (self._taking.subgoal, self._perception)
        attempt = Attempt(*of, outcome, execution, self._planning_s, self._held, recovery)
        self._attempts.append(attempt)
        self._planning_s = 0.0

    def _ended(self, recovery: str, free: bool) -> PickOutcome:
        """Go home where the hand is free; return the attempts, the last with what was done then."""
        home = free and self._go_home()
        if not home:
            recovery = f"{recovery}; {_NO_WAY_HOME if free else _CAUGHT}"
        self._attempts[-1] = replace(self._attempts[-1], recovery=recovery)
        return PickOutcome(tuple(self._attempts), home)
