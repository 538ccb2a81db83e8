"""One pick with a robot that loses its object, lets it slip, meets an obstacle, or sees it turned.

The robot sees nothing unless a test says what; the planner returns the placement it is given.
"""

from collections.abc import Callable

import numpy as np
import pytest

from planning.execution.faults import Fault
from planning.goals.upright import SUBGOAL as REORIENT
from planning.handling.attempts import AttemptLimits
from planning.handling.handler import BEARABLE_SHIFT_M, KEPT_SHIFT_M
from planning.handling.held_view import HeldView
from planning.motion.free import NoMotion
from planning.problem import Segment, SegmentName, Stage
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from tests.helpers.handling import (
    WIDTH_M,
    Placer,
    blocking_floor_m,
    failures,
    handle,
    placing,
    sees,
)
from tests.helpers.planning import STANDING, mug_problem, reorient_plan
from tests.helpers.robot import PerfectRobot


def test_where_nothing_happens_the_plan_is_executed_as_it_is() -> None:
    robot, planner = PerfectRobot(WIDTH_M), Placer()
    handled = handle(robot, planner)
    (attempt,) = handled.attempts
    assert attempt.failure == (None, "") and attempt.recovery == ""
    assert attempt.execution is not None and attempt.execution.completed
    assert [log.name for log in attempt.execution.logs] == [
        segment.name for segment in reorient_plan().segments
    ]
    assert attempt.planning_s == 0.5
    assert attempt.held is not None and "voxels were seen" in attempt.held.rejected
    assert planner.asked == []


def test_an_empty_grasp_ends_at_home() -> None:
    robot, planner = PerfectRobot(0.0), Placer()
    handled = handle(robot, planner)
    (attempt,) = handled.attempts
    assert attempt.failure[0] is Stage.GRASP and "empty after close" in attempt.failure[1]
    assert attempt.held is None and attempt.recovery == "drew back"
    assert handled.home and planner.asked == []
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_the_rest_is_planned_anew_from_how_the_object_is_seen_to_lie(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    X_GE = make_pose(p=(0.0, 0.0, 2.0 * KEPT_SHIFT_M))
    sees(monkeypatch, X_GE)
    planner = Placer(placing())
    handled = handle(PerfectRobot(WIDTH_M), planner)
    assert failures(handled) == [None, None]
    assert handled.attempts[0].recovery == "planned anew from how it lay in the hand"
    (problem,) = planner.asked
    assert problem.held_width_m == pytest.approx(WIDTH_M)
    plan, before = reorient_plan(), mug_problem(REORIENT, STANDING)
    q_lifted = plan.pick[-1].trajectory.qs[-1]
    np.testing.assert_allclose(problem.q_start, q_lifted)
    X_WMoved = gripper_pose(q_lifted) @ X_GE @ np.linalg.inv(plan.X_WGrasp)
    np.testing.assert_allclose(problem.p_WPs, transform_points(X_WMoved, before.p_WPs))
    np.testing.assert_allclose(
        problem.pose_sets["upright"].X_WPs, X_WMoved @ STANDING[None], atol=1e-9
    )
    assert problem.X_WGfailed.shape == (0, 4, 4)
    lifted, placed = (attempt.execution for attempt in handled.attempts)
    assert lifted is not None and placed is not None
    assert len(lifted.logs) == len(plan.pick) and len(placed.logs) == len(plan.place)


def test_a_plan_that_is_nearly_right_goes_on_where_there_is_no_better_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sees(monkeypatch, make_pose(p=(0.0, 0.0, 0.5 * (KEPT_SHIFT_M + BEARABLE_SHIFT_M))))
    handled = handle(PerfectRobot(WIDTH_M), Placer())
    assert failures(handled) == [None, Stage.PLANNING, None]
    assert handled.attempts[1].recovery == "placed by the first plan"
    last = handled.attempts[-1].execution
    assert last is not None and last.completed


def test_an_object_that_can_be_placed_nowhere_is_put_down(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sees(monkeypatch, make_pose(p=(0.0, 0.0, 2.0 * BEARABLE_SHIFT_M)))
    robot, names = PerfectRobot(WIDTH_M), list[SegmentName]()
    handled = handle(robot, Placer(), lambda segment: names.append(segment.name))
    assert failures(handled) == [None, Stage.PLANNING]
    assert handled.attempts[-1].recovery == "put the object down"
    assert handled.home and SegmentName.OPEN in names and SegmentName.TRANSFER not in names
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_an_object_that_is_not_as_it_was_taken_is_put_down(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lost = HeldView(np.eye(4), 0.4, "40% of it matches", elsewhere=True)
    monkeypatch.setattr("planning.handling.handler.view_held", lambda *_: lost)
    robot, planner = PerfectRobot(WIDTH_M), Placer(placing())
    handled = handle(robot, planner)
    assert failures(handled) == [Stage.GRASP] and planner.asked == []
    (attempt,) = handled.attempts
    assert "not as it was taken: 40% of it matches" in attempt.failure[1]
    assert attempt.recovery == "put the object down" and handled.home
    assert attempt.execution is not None and attempt.execution.fault is Fault.SLIPPED


def test_a_blocked_insertion_is_tried_otherwise_and_given_up_in_the_end() -> None:
    robot, planner = PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Placer(placing())
    handled = handle(robot, planner, limits=AttemptLimits(placements=3))
    assert failures(handled) == [Stage.PLACEMENT] * 3
    assert all("in the way" in attempt.failure[1] for attempt in handled.attempts)
    assert [len(problem.X_WGfailed) for problem in planner.asked] == [1, 2]
    np.testing.assert_array_equal(planner.asked[0].X_WGfailed[0], reorient_plan().X_WGplace)
    assert handled.attempts[-1].recovery == "put the object down" and handled.home


def test_a_way_in_that_is_free_the_second_time_is_taken() -> None:
    robot, planner = PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Placer(placing())

    def clear(segment: Segment) -> None:
        if segment.name is SegmentName.BACK_OUT:
            robot.floor_m = -np.inf

    handled = handle(robot, planner, clear)
    assert failures(handled) == [Stage.PLACEMENT, None]
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "stage", "forbidden"),
    [(SegmentName.TRANSFER, Stage.TRANSPORT, 0), (SegmentName.INSERT, Stage.PLACEMENT, 1)],
)
def test_a_slip_leads_back_and_forbids_the_placement_that_made_it(
    name: SegmentName, stage: Stage, forbidden: int
) -> None:
    robot, planner = PerfectRobot(WIDTH_M), Placer(placing())

    def slip(segment: Segment) -> None:
        if segment.name is name:
            robot.object_m = 0.5 * WIDTH_M

    handled = handle(robot, planner, slip)
    assert failures(handled) == [stage, None]
    (problem,) = planner.asked
    assert problem.X_WGfailed.shape == (forbidden, 4, 4)
    assert problem.held_width_m == pytest.approx(0.5 * WIDTH_M)
    np.testing.assert_allclose(
        problem.q_start, reorient_plan().place[0].trajectory.qs[0], atol=1e-6
    )


def lose(robot: PerfectRobot, name: SegmentName) -> Callable[[Segment], None]:
    """Return what makes the robot lose its object in the segments of a name."""

    def on_step(segment: Segment) -> None:
        if segment.name is name:
            robot.object_m = 0.0

    return on_step


def test_an_object_lost_on_the_way_is_not_placed() -> None:
    robot, planner = PerfectRobot(WIDTH_M), Placer()
    handled = handle(robot, planner, lose(robot, SegmentName.TRANSFER))
    assert failures(handled) == [Stage.TRANSPORT]
    assert handled.attempts[-1].recovery == "drew back"
    assert handled.home and planner.asked == []


def test_an_object_lost_on_the_way_back_is_not_placed_either() -> None:
    robot, planner = PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Placer()
    handled = handle(robot, planner, lose(robot, SegmentName.BACK_OUT))
    assert failures(handled) == [Stage.PLACEMENT]
    assert handled.attempts[-1].recovery == "the object was lost on the way back"
    assert planner.asked == []


def test_a_robot_that_finds_no_way_home_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planning.handling.recovery.free_motion", lambda *_: NoMotion("walled in"))
    handled = handle(PerfectRobot(0.0), Placer())
    assert not handled.home
    assert handled.attempts[-1].recovery == "drew back; no way home was found"


def test_a_plan_that_takes_what_is_in_the_hand_is_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    sees(monkeypatch, make_pose(p=(0.0, 0.0, 2.0 * BEARABLE_SHIFT_M)))
    handled = handle(PerfectRobot(WIDTH_M), Placer(reorient_plan()))
    stage, reason = handled.attempts[-1].failure
    assert stage is Stage.PLANNING and "begins with transit; expected transfer" in reason
    assert handled.attempts[-1].recovery == "put the object down"


def test_without_held_views_the_plan_is_executed_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    sees(monkeypatch, make_pose(p=(0.0, 0.0, 2.0 * BEARABLE_SHIFT_M)))
    planner, limits = Placer(placing()), AttemptLimits.without_feedback()
    handled = handle(PerfectRobot(WIDTH_M), planner, limits=limits)
    assert failures(handled) == [None] and planner.asked == []
    assert handled.attempts[0].held is not None
    assert handled.attempts[0].held.rejected == "not looked at"


def test_the_next_look_starts_from_what_was_seen_last(monkeypatch: pytest.MonkeyPatch) -> None:
    X_GE = make_pose(p=(0.0, 0.0, 0.5 * (KEPT_SHIFT_M + BEARABLE_SHIFT_M)))
    expected: list[Array] = []

    def view(*arguments: object) -> HeldView:
        expected.append(np.asarray(arguments[-2]))
        return HeldView(X_GE, matched=1.0)

    monkeypatch.setattr("planning.handling.handler.view_held", view)
    handle(PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Placer())
    first, second = expected[:2]
    np.testing.assert_array_equal(first, np.eye(4))
    np.testing.assert_array_equal(second, X_GE)


def test_the_time_of_each_plan_is_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, planner = PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Placer(placing())
    # A second passes with each plan, and else what the robot takes.
    clock = "planning.handling.timed_planning.time.monotonic"
    monkeypatch.setattr(clock, lambda: robot.time_s + len(planner.asked))
    handled = handle(robot, planner, limits=AttemptLimits(placements=3))
    assert [attempt.planning_s for attempt in handled.attempts] == pytest.approx([0.5, 1.0, 1.0])
    sees(monkeypatch, make_pose(p=(0.0, 0.0, 2.0 * BEARABLE_SHIFT_M)))
    handled = handle(PerfectRobot(WIDTH_M), Placer(placing()))
    assert [attempt.planning_s for attempt in handled.attempts] == [0.5, 0.0]


def test_an_object_that_turned_after_a_failure_does_not_hide_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    views = iter([HeldView(np.eye(4), 1.0), HeldView(np.eye(4), 0.4, "40%", elsewhere=True)])
    monkeypatch.setattr("planning.handling.handler.view_held", lambda *_: next(views))
    robot, planner = PerfectRobot(WIDTH_M, floor_m=blocking_floor_m()), Placer(placing())
    handled = handle(robot, planner)
    assert failures(handled) == [Stage.PLACEMENT] and planner.asked == []
    assert handled.attempts[-1].recovery.startswith("put the object down")
