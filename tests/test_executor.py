"""Execution and sequencing against a robot that follows its commands exactly."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from helpers_planning import LYING, UPRIGHT, mug_problem

from planning.executor import Executor, gripper_force
from planning.faults import CONTACT_FORCE_N
from planning.kinematics import gripper_jacobian, gripper_pose
from planning.planner import make_planner
from planning.problem import (
    Plan,
    PlanFailure,
    PlanningProblem,
    Segment,
    SegmentName,
    Stage,
    Subgoal,
)
from planning.sequencer import Sequencer
from planning.timing import SAMPLE_S
from split_drake.camera import DepthView
from split_drake.panda import Q_HOME
from split_drake.pose_set import PoseSet, PoseTask
from split_drake.poses import Array
from split_drake.scene import EmptySceneError, Scene, Workspace


@dataclass
class PerfectRobot:
    """Goes where it is told; its fingers stop at `object_m`, a floor at `floor_m` pushes back.

    The object is lost at `lost_s`.
    The floor acts on the gripper's origin, as a spring of 20 N/mm.
    """

    object_m: float = 0.004
    lost_s: float = np.inf
    floor_m: float = -np.inf
    q: Array = field(default_factory=Q_HOME.copy)
    opening_m: float = 0.08
    time_s: float = 0.0

    @property
    def joint_torques_nm(self) -> Array:
        depth = max(0.0, self.floor_m - gripper_pose(self.q)[2, 3])
        return gripper_jacobian(self.q).T @ (0.0, 0.0, -20e3 * depth)

    def command(self, q: Array, v: Array, opening_m: float, force_n: float) -> None:
        assert q.shape == v.shape == (7,)
        assert force_n > 0.0
        self.q = q.copy()
        held_m = self.object_m if self.time_s < self.lost_s else 0.0
        self.opening_m = max(opening_m, held_m)

    def advance(self, duration_s: float) -> None:
        self.time_s += duration_s

    def capture(self) -> tuple[DepthView, ...]:
        return ()


@pytest.fixture(scope="module")
def plan() -> Plan:
    found = make_planner("default").plan(
        mug_problem(Subgoal.REORIENT, UPRIGHT), np.random.default_rng(0)
    )
    assert isinstance(found, Plan)
    return found


def test_a_plan_runs_to_its_end_in_real_time(plan: Plan) -> None:
    robot, steps = PerfectRobot(), list[Segment]()
    result = Executor(robot, steps.append).run(plan.segments)
    assert result.completed and result.stage is None and result.reason == ""
    assert [log.name for log in result.logs] == [segment.name for segment in plan.segments]
    assert robot.time_s == pytest.approx(len(steps) * SAMPLE_S)
    assert result.duration_s == pytest.approx(robot.time_s, abs=1e-9)
    assert max(log.tracking_error_rad for log in result.logs) < 1e-9
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_the_time_since_release_counts_what_follows_opening(plan: Plan) -> None:
    robot, opened_s = PerfectRobot(), 0.0

    def watch(segment: Segment) -> None:
        nonlocal opened_s
        if segment.name is SegmentName.OPEN:
            opened_s = robot.time_s

    result = Executor(robot, watch).run(plan.segments)
    assert opened_s > 0.0
    assert result.since_release_s == pytest.approx(robot.time_s - opened_s, abs=1e-9)


def test_an_empty_hand_ends_the_execution(plan: Plan) -> None:
    result = Executor(PerfectRobot(object_m=0.0)).run(plan.segments)
    assert not result.completed
    assert result.stage is Stage.GRASP
    assert result.logs[-1].name is SegmentName.CLOSE
    assert "0.0 mm" in result.reason
    with pytest.raises(ValueError, match="released"):
        _ = result.since_release_s


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        (SegmentName.LIFT, Stage.GRASP),
        (SegmentName.TRANSFER, Stage.TRANSPORT),
        (SegmentName.INSERT, Stage.PLACEMENT),
    ],
)
def test_a_lost_object_fails_the_stage_it_was_lost_in(
    plan: Plan, name: SegmentName, stage: Stage
) -> None:
    names = [segment.name for segment in plan.segments]
    before = plan.segments[: names.index(name)]
    begins_s = SAMPLE_S * sum(len(segment.trajectory.times_s) for segment in before)
    result = Executor(PerfectRobot(lost_s=begins_s + 0.05)).run(plan.segments)
    assert not result.completed
    assert result.logs[-1].name is name
    assert result.stage is stage
    assert name.value in result.reason


def test_lowering_stops_on_contact_and_keeps_the_height_while_letting_go(plan: Plan) -> None:
    lowering = next(segment for segment in plan.segments if segment.stop_on_contact)
    heights = [gripper_pose(q)[2, 3] for q in lowering.trajectory.qs[[0, -1]]]
    floor_m = 0.5 * (heights[0] + heights[1])
    robot = PerfectRobot(floor_m=floor_m)
    reached: dict[SegmentName, list[float]] = {}

    def watch(segment: Segment) -> None:
        reached.setdefault(segment.name, []).append(gripper_pose(robot.q)[2, 3])

    result = Executor(robot, watch).run(plan.segments)
    assert result.completed
    assert result.duration_s == pytest.approx(robot.time_s, abs=1e-9)
    stopped = [log.stopped_by_contact for log in result.logs]
    assert stopped == [segment.stop_on_contact for segment in plan.segments]
    pressed_m = floor_m - reached[SegmentName.INSERT][-1]
    assert CONTACT_FORCE_N / 20e3 < pressed_m < 0.002
    np.testing.assert_allclose(reached[SegmentName.OPEN], reached[SegmentName.INSERT][-1])
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_the_force_at_the_gripper_is_recovered_from_torques() -> None:
    q, force = Q_HOME, np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(gripper_force(q, gripper_jacobian(q).T @ force), force)


def scene_of(problem: PlanningProblem) -> Scene:
    return Scene(problem.p_WPs, problem.p_WPs[:2000], Workspace())


class Looks:
    """Shows one problem after the other, and counts the tasks asked for."""

    def __init__(self, *problems: PlanningProblem) -> None:
        self._problems = list(problems)
        self.asked: list[tuple[PoseTask, ...]] = []

    def __call__(self, tasks: Sequence[PoseTask]) -> tuple[Scene, dict[PoseTask, PoseSet]]:
        self.asked.append(tuple(tasks))
        problem = self._problems.pop(0)
        return scene_of(problem), {task: problem.pose_sets[task] for task in tasks}


class FailingHang:
    """Plans reorientations as usual and fails to hang until the object was reoriented."""

    def __init__(self, failures: int) -> None:
        self._failures = failures
        self._planner = make_planner("default")

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        if problem.subgoal is Subgoal.HANG and self._failures:
            self._failures -= 1
            return PlanFailure(Stage.PLANNING, "no")
        return self._planner.plan(problem, rng)


def test_hanging_falls_back_to_reorienting_and_looks_again() -> None:
    looks = Looks(mug_problem(Subgoal.HANG, LYING), mug_problem(Subgoal.HANG, UPRIGHT))
    sequencer = Sequencer(FailingHang(1), looks, Executor(PerfectRobot()))
    result = sequencer.run(Subgoal.HANG, np.random.default_rng(0))
    assert result.completed and result.reason == ""
    subgoals = [attempt.subgoal for attempt in result.attempts]
    assert subgoals == [Subgoal.HANG, Subgoal.REORIENT, Subgoal.HANG]
    assert len(looks.asked) == 2
    assert set(looks.asked[0]) == set(PoseTask)
    assert result.attempts[0].execution is None
    assert result.planning_s > 0.0 and result.execution_s > 0.0


def test_attempts_are_bounded_and_the_reason_is_the_last() -> None:
    looks = Looks(*[mug_problem(Subgoal.HANG, LYING)] * 3)
    sequencer = Sequencer(FailingHang(9), looks, Executor(PerfectRobot()))
    result = sequencer.run(Subgoal.HANG, np.random.default_rng(0))
    assert not result.completed
    assert result.stage is Stage.PLANNING and result.reason == "no"
    assert len(result.attempts) == 3


def test_reorienting_alone_is_one_attempt() -> None:
    looks = Looks(mug_problem(Subgoal.REORIENT, LYING))
    sequencer = Sequencer(make_planner("default"), looks, Executor(PerfectRobot()))
    result = sequencer.run(Subgoal.REORIENT, np.random.default_rng(0))
    assert result.completed
    assert set(looks.asked[0]) == set(Subgoal.REORIENT.tasks)


def test_a_failed_grasp_is_the_sequences_failure() -> None:
    looks = Looks(mug_problem(Subgoal.REORIENT, LYING))
    executor = Executor(PerfectRobot(object_m=0.0))
    result = Sequencer(make_planner("default"), looks, executor).run(
        Subgoal.REORIENT, np.random.default_rng(0)
    )
    assert result.stage is Stage.GRASP and "empty" in result.reason


def test_an_empty_scene_is_a_failure_of_perception() -> None:
    def nothing(tasks: Sequence[PoseTask]) -> tuple[Scene, dict[PoseTask, PoseSet]]:
        raise EmptySceneError("nothing there")

    sequencer = Sequencer(make_planner("default"), nothing, Executor(PerfectRobot()))
    result = sequencer.run(Subgoal.HANG, np.random.default_rng(0))
    assert result.stage is Stage.PERCEPTION and result.reason == "nothing there"
    assert result.attempts == ()
