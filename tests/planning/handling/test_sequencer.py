"""Tasks from their first look to their end, with a robot that does exactly what it is told."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from planning.execution.executor import Executor
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.handling.attempts import AttemptLimits
from planning.handling.sequencer import Perceive, Sequencer
from planning.planner import make_planner
from planning.problem import (
    Plan,
    PlanFailure,
    PlanningProblem,
    Segment,
    SegmentName,
    Stage,
)
from planning.subgoal import Subgoal
from split_drake.pose_set import PoseSet
from split_drake.pose_task import MUG_TASKS, UPRIGHT, PoseTask
from split_drake.poses import make_pose
from split_drake.scene import EmptySceneError, Scene, Workspace
from split_drake.station.layout import Layout
from tests.helpers.handling import WIDTH_M, blocking_floor_m, placing
from tests.helpers.planning import LYING, STANDING, mug_problem, reorient_plan
from tests.helpers.robot import PerfectRobot


def scene_of(problem: PlanningProblem) -> Scene:
    return Scene.from_points(problem.p_WPs, Workspace())


class Looks:
    """Shows one problem after the other, and counts the tasks asked for."""

    def __init__(self, *problems: PlanningProblem) -> None:
        self._problems = list(problems)
        self.asked: list[tuple[PoseTask, ...]] = []
        self.again: list[bool] = []

    def __call__(self, tasks: Sequence[PoseTask], again: bool) -> tuple[Scene, dict[str, PoseSet]]:
        self.asked.append(tuple(tasks))
        self.again.append(again)
        problem = self._problems.pop(0)
        return scene_of(problem), {task.name: problem.pose_sets[task.name] for task in tasks}


class FailingHang:
    """Plans reorientations as usual and fails to hang until the object was reoriented."""

    def __init__(self, failures: int) -> None:
        self._failures = failures
        self._planner = make_planner("default")

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        if problem.subgoal == HANG and self._failures:
            self._failures -= 1
            return PlanFailure(Stage.PLANNING, "no")
        return self._planner.plan(problem, rng)


class KnownPlan:
    """Answers every problem with one plan, and keeps what it was asked."""

    def __init__(self) -> None:
        self.asked: list[PlanningProblem] = []

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        self.asked.append(problem)
        return reorient_plan()


def test_hanging_falls_back_to_reorienting_and_looks_again() -> None:
    looks = Looks(mug_problem(HANG, LYING), mug_problem(HANG, STANDING))
    sequencer = Sequencer(FailingHang(1), looks, Executor(PerfectRobot()), Layout())
    result = sequencer.reach(HANG, np.random.default_rng(0))
    assert result.completed and result.reason == ""
    subgoals = [attempt.subgoal for attempt in result.attempts]
    assert subgoals == [HANG, REORIENT, HANG]
    assert looks.again == [False, False], "what was perceived first led to a reorientation"
    assert set(looks.asked[0]) == set(MUG_TASKS)
    assert result.attempts[0].execution is None
    assert result.planning_s > 0.0 and result.execution_s > 0.0


def test_what_cannot_be_planned_is_looked_at_again_but_not_for_ever() -> None:
    looks = Looks(*[mug_problem(HANG, LYING)] * 3)
    limits = AttemptLimits(looks=2)
    sequencer = Sequencer(FailingHang(9), looks, Executor(PerfectRobot()), Layout(), limits)
    result = sequencer.reach(HANG, np.random.default_rng(0))
    assert not result.completed
    assert result.stage is Stage.PLANNING and result.reason == "no"
    subgoals = [attempt.subgoal for attempt in result.attempts]
    assert subgoals == [HANG, REORIENT, HANG, HANG]
    assert looks.again == [False, False, True]


def test_the_reasons_of_all_subgoals_are_given() -> None:
    class Never:
        def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> PlanFailure:
            return PlanFailure(Stage.PLANNING, f"no {problem.subgoal}")

    looks = Looks(*[mug_problem(HANG, LYING)] * 2)
    sequencer = Sequencer(Never(), looks, Executor(PerfectRobot()), Layout())
    result = sequencer.reach(HANG, np.random.default_rng(0))
    assert result.reason == "hang: no hang; reorient: no reorient"
    assert len(result.attempts) == 4


class PlansOf:
    """Has a plan, always the same way, for one subgoal and none for any other."""

    def __init__(self, *subgoals: Subgoal) -> None:
        self._subgoals = subgoals

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        if problem.subgoal in self._subgoals:
            return replace(reorient_plan(), subgoal=problem.subgoal)
        return PlanFailure(Stage.PLANNING, f"no {problem.subgoal}")


def test_a_goal_is_not_reached_by_what_comes_before_it() -> None:
    tidy = replace(REORIENT, name="tidy", first=replace(REORIENT, name="lift first"))
    looks = Looks(*[mug_problem(tidy, STANDING)] * 3)
    assert tidy.first is not None
    sequencer = Sequencer(PlansOf(tidy.first), looks, Executor(PerfectRobot()), Layout())
    result = sequencer.reach(tidy, np.random.default_rng(0))
    assert not result.completed and result.stage is Stage.PLANNING
    tried = [str(attempt.subgoal) for attempt in result.attempts]
    assert tried == ["tidy", "lift first", "tidy", "tidy"]


def test_a_chain_of_subgoals_is_gone_down_as_far_as_it_must_be() -> None:
    last = replace(REORIENT, name="c")
    middle = replace(HANG, name="b", first=last)
    top = replace(HANG, name="top", first=middle)
    looks = Looks(*[mug_problem(top, STANDING)] * 3)
    sequencer = Sequencer(PlansOf(last), looks, Executor(PerfectRobot()), Layout())
    result = sequencer.reach(top, np.random.default_rng(0))
    tried = [str(attempt.subgoal) for attempt in result.attempts]
    assert tried == ["top", "b", "c", "top", "b", "top", "b"]
    assert result.reason == "top: no top; b: no b"
    assert set(looks.asked[0]) == set(MUG_TASKS)
    assert result.attempts[2].execution is not None


def test_a_reorientation_is_looked_at_once_it_is_done() -> None:
    looks = Looks(*[mug_problem(REORIENT, STANDING)] * 2)
    sequencer = Sequencer(KnownPlan(), looks, Executor(PerfectRobot()), Layout())
    result = sequencer.reach(REORIENT, np.random.default_rng(0))
    assert result.completed and len(result.attempts) == 1
    assert looks.asked == [REORIENT.tasks] * 2


def test_an_object_that_fell_over_is_stood_up_again() -> None:
    standing, lying = (mug_problem(REORIENT, X_WO) for X_WO in (STANDING, LYING))
    planner, looks = KnownPlan(), Looks(standing, lying, standing)
    result = Sequencer(planner, looks, Executor(PerfectRobot()), Layout()).reach(
        REORIENT, np.random.default_rng(0)
    )
    assert result.completed and len(result.attempts) == len(planner.asked) == 2


def test_an_object_that_always_falls_over_is_stood_up_so_often_only() -> None:
    lying = mug_problem(REORIENT, LYING)
    planner, looks = KnownPlan(), Looks(*[lying] * 3)
    limits = AttemptLimits(picks=2)
    sequencer = Sequencer(planner, looks, Executor(PerfectRobot()), Layout(), limits)
    result = sequencer.reach(REORIENT, np.random.default_rng(0))
    assert result.completed and len(result.attempts) == 2


def test_an_object_that_seemed_tilted_once_still_stands() -> None:
    class Once(KnownPlan):
        def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
            plan = super().plan(problem, rng)
            return plan if len(self.asked) == 1 else PlanFailure(Stage.PLANNING, "no")

    standing, lying = (mug_problem(REORIENT, X_WO) for X_WO in (STANDING, LYING))
    looks = Looks(standing, lying, standing)
    result = Sequencer(Once(), looks, Executor(PerfectRobot()), Layout()).reach(
        REORIENT, np.random.default_rng(0)
    )
    assert result.completed
    assert [attempt.failure[0] for attempt in result.attempts] == [None, Stage.PLANNING]


def test_a_plan_for_something_else_is_refused() -> None:
    looks = Looks(mug_problem(HANG, STANDING))
    sequencer = Sequencer(KnownPlan(), looks, Executor(PerfectRobot()), Layout())
    with pytest.raises(ValueError, match="a plan to reorient was made where one to hang was due"):
        sequencer.reach(HANG, np.random.default_rng(0))


def test_failed_grasps_stay_where_they_were_if_no_upright_pose_is_seen() -> None:
    seen = mug_problem(REORIENT, make_pose(p=(0.03, 0.0, 0.0)) @ STANDING)
    none = PoseSet(UPRIGHT, np.empty((0, 4, 4)), np.empty(0))
    blind = replace(seen, pose_sets={**seen.pose_sets, "upright": none})
    planner, looks = KnownPlan(), Looks(seen, blind)
    limits = AttemptLimits(picks=2)
    sequencer = Sequencer(planner, looks, Executor(PerfectRobot(object_m=0.0)), Layout(), limits)
    sequencer.reach(REORIENT, np.random.default_rng(0))
    np.testing.assert_array_equal(planner.asked[1].X_WGfailed, [reorient_plan().X_WGrasp])


def test_an_empty_grasp_is_followed_by_another_one() -> None:
    robot, planner = PerfectRobot(object_m=0.0), KnownPlan()
    moved = make_pose(p=(0.03, 0.0, 0.0))
    problems = [mug_problem(REORIENT, X @ STANDING) for X in (np.eye(4), moved, moved)]

    def come_back(segment: Segment) -> None:
        if segment.name is SegmentName.RETREAT:
            robot.object_m = 0.005

    executor = Executor(robot, come_back)
    result = Sequencer(planner, Looks(*problems), executor, Layout()).reach(
        REORIENT, np.random.default_rng(0)
    )
    assert result.completed
    assert [attempt.failure[0] for attempt in result.attempts] == [Stage.GRASP, None]
    first, second = planner.asked
    assert len(first.X_WGfailed) == 0
    np.testing.assert_allclose(second.X_WGfailed, [moved @ reorient_plan().X_WGrasp])


def test_picks_are_bounded_and_the_last_failure_is_the_sequences() -> None:
    looks = Looks(*[mug_problem(REORIENT, STANDING)] * 3)
    planner, executor = KnownPlan(), Executor(PerfectRobot(object_m=0.0))
    result = Sequencer(planner, looks, executor, Layout(), AttemptLimits(picks=3)).reach(
        REORIENT, np.random.default_rng(0)
    )
    assert result.stage is Stage.GRASP and "empty" in result.reason
    assert len(result.attempts) == 3
    assert [len(problem.X_WGfailed) for problem in planner.asked] == [0, 1, 2]


def test_the_time_of_the_way_back_is_the_executions_and_that_of_planning_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Replanning(KnownPlan):
        def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
            plan = super().plan(problem, rng)
            return plan if problem.held_width_m is None else placing()

    robot, planner = PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Replanning()
    # A second passes with each plan, and else what the robot takes.
    clock = "planning.handling.sequencer.time.monotonic"
    monkeypatch.setattr(clock, lambda: robot.time_s + len(planner.asked))
    looks, limits = Looks(mug_problem(REORIENT, STANDING)), AttemptLimits(picks=1, placements=2)
    sequencer = Sequencer(planner, looks, Executor(robot), Layout(), limits)
    result = sequencer.reach(REORIENT, np.random.default_rng(0))
    assert result.attempts[-1].recovery == "put the object down"
    assert len(planner.asked) == 2 and result.planning_s == pytest.approx(2.0)
    assert result.execution_s == pytest.approx(robot.time_s) and robot.time_s > 0.0
    assert result.perception_s == 0.0


def test_a_grasp_that_failed_is_not_planned_again() -> None:
    problem = mug_problem(REORIENT, STANDING)
    planner = make_planner("default")
    failed = reorient_plan().X_WGrasp
    again = PlanningProblem(
        problem.subgoal,
        problem.pose_sets,
        problem.p_WPs,
        problem.q_start,
        problem.layout,
        X_WGfailed=failed[None],
    )
    other = planner.plan(again, np.random.default_rng(0))
    assert isinstance(other, Plan)
    assert np.linalg.norm(other.X_WGrasp[:3, 3] - failed[:3, 3]) > 0.005


def nothing_after(*problems: PlanningProblem) -> Perceive:
    """Return looks that show the problems and then an empty scene."""
    looks = Looks(*problems)

    def look(tasks: Sequence[PoseTask], again: bool) -> tuple[Scene, dict[str, PoseSet]]:
        if len(looks.asked) == len(problems):
            raise EmptySceneError("nothing there")
        return looks(tasks, again)

    return look


def test_an_empty_scene_is_a_failure_of_perception() -> None:
    sequencer = Sequencer(KnownPlan(), nothing_after(), Executor(PerfectRobot()), Layout())
    result = sequencer.reach(HANG, np.random.default_rng(0))
    assert result.stage is Stage.PERCEPTION and result.reason == "nothing there"
    assert result.attempts == ()


def test_an_object_that_is_lost_for_good_failed_where_it_was_lost() -> None:
    looks = nothing_after(mug_problem(REORIENT, STANDING))
    executor = Executor(PerfectRobot(object_m=0.0))
    result = Sequencer(KnownPlan(), looks, executor, Layout()).reach(
        REORIENT, np.random.default_rng(0)
    )
    assert result.stage is Stage.GRASP
    assert "empty after close" in result.reason and result.reason.endswith("then nothing there")


@pytest.mark.parametrize(
    ("limits", "what"),
    [
        (lambda: AttemptLimits(picks=0), "picks is 0"),
        (lambda: AttemptLimits(placements=0), "placements is 0"),
        (lambda: AttemptLimits(firsts=-1), "firsts is -1"),
        (lambda: AttemptLimits(looks=0), "looks is 0"),
    ],
)
def test_limits_that_allow_nothing_are_refused(
    limits: Callable[[], AttemptLimits], what: str
) -> None:
    with pytest.raises(ValueError, match=what):
        limits()
