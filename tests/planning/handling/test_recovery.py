"""The ways back that a robot drives after a failure."""

from itertools import pairwise

import numpy as np
import pytest

from planning.execution.executor import ExecutionResult, Executor, SegmentLog
from planning.handling.recovery import Recovery
from planning.handling.retracing import put_down_segments, retraced, withdrawal
from planning.motion.free import NoMotion
from planning.problem import SAMPLE_S, Segment, SegmentName
from split_drake.poses import transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout
from tests.helpers.planning import mug_cloud, reorient_plan
from tests.helpers.robot import PerfectRobot


def executed(segments: tuple[Segment, ...], last_s: float | None = None) -> ExecutionResult:
    """Return the result of driving segments, the last one for `last_s` only where given."""
    durations = [SAMPLE_S * len(segment.trajectory.times_s) for segment in segments]
    if last_s is not None:
        durations[-1] = last_s
    logs = [
        SegmentLog(segment.name, duration, 0.0, 0.005, False)
        for segment, duration in zip(segments, durations, strict=True)
    ]
    return ExecutionResult(last_s is None, tuple(logs))


def test_a_placement_is_backed_out_of_the_way_it_went() -> None:
    place = reorient_plan().place
    half_s = 0.5 * place[1].trajectory.duration_s
    back = retraced(place, executed(place[:2], last_s=half_s))
    assert [segment.name for segment in back] == [SegmentName.BACK_OUT] * 2
    assert all(segment.holding and not segment.stop_on_contact for segment in back)
    reached = place[1].trajectory.qs[round(half_s / SAMPLE_S) - 1]
    np.testing.assert_allclose(back[0].trajectory.qs[0], reached, atol=1e-6)
    for one, other in pairwise(back):
        np.testing.assert_allclose(one.trajectory.qs[-1], other.trajectory.qs[0], atol=1e-6)
    np.testing.assert_allclose(back[-1].trajectory.qs[-1], place[0].trajectory.qs[0], atol=1e-6)


def test_nothing_is_retraced_where_nothing_was_executed() -> None:
    assert retraced(reorient_plan().place, ExecutionResult(False, ())) == ()


def test_an_empty_hand_draws_back_from_where_it_closed() -> None:
    pick = reorient_plan().pick
    (back,) = withdrawal(pick, executed(pick[:3]))
    assert back.name is SegmentName.RETREAT and not back.holding
    approach = pick[1].trajectory
    np.testing.assert_allclose(back.trajectory.qs[0], approach.qs[-1], atol=1e-6)
    np.testing.assert_allclose(back.trajectory.qs[-1], approach.qs[0], atol=1e-6)


@pytest.mark.parametrize(("count", "expected"), [(1, 0), (2, 1), (3, 2)])
def test_an_empty_hand_draws_back_from_the_hook_only(count: int, expected: int) -> None:
    place = reorient_plan().place
    back = withdrawal(place, executed(place[:count]))
    assert len(back) == expected
    if back:
        np.testing.assert_allclose(back[-1].trajectory.qs[-1], place[1].trajectory.qs[0], atol=1e-6)


def test_an_object_is_put_down_where_it_was_taken_by_feel() -> None:
    plan = reorient_plan()
    felt, opening, back = put_down_segments(plan)
    lift, approach = plan.pick[3].trajectory, plan.pick[1].trajectory
    assert felt.stop_on_contact
    np.testing.assert_allclose(felt.trajectory.qs[0], lift.qs[-1], atol=1e-6)
    np.testing.assert_allclose(felt.trajectory.qs[-1], lift.qs[0], atol=1e-6)
    assert opening.name is SegmentName.OPEN
    assert opening.opening_end_m == pytest.approx(plan.pick[1].opening_end_m)
    np.testing.assert_allclose(back.trajectory.qs[-1], approach.qs[0], atol=1e-6)


@pytest.mark.parametrize("hanging_m", [0.008, 0.05])
def test_putting_down_stops_on_the_table_however_low_the_object_hangs(hanging_m: float) -> None:
    plan = reorient_plan()
    table_m = gripper_pose(plan.pick[3].trajectory.qs[0])[2, 3] + hanging_m
    robot = PerfectRobot(floor_m=table_m, q=plan.pick[3].trajectory.qs[-1].copy())
    reached: list[float] = []
    executor = Executor(
        robot,
        lambda segment: (
            reached.append(gripper_pose(robot.q)[2, 3])
            if segment.name is SegmentName.OPEN
            else None
        ),
    )
    assert Recovery(executor, Layout(), ways_out=0).put_down(plan)
    assert table_m - 0.002 < reached[0] < table_m
    assert robot.opening_m == pytest.approx(plan.pick[1].opening_end_m)


def test_home_is_reached_around_what_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = reorient_plan()
    robot = PerfectRobot(object_m=0.0, q=plan.pick[1].trajectory.qs[0].copy())
    standing = transform_points(plan.X_WObject, mug_cloud())
    monkeypatch.setattr("planning.handling.recovery.beside_robot", lambda *_: standing)
    assert Recovery(Executor(robot), Layout(), ways_out=0).go_home(np.random.default_rng(0))
    np.testing.assert_allclose(robot.q, Q_HOME, atol=1e-6)


def test_the_arm_stays_where_no_way_home_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    q = reorient_plan().pick[1].trajectory.qs[0]
    robot = PerfectRobot(object_m=0.0, q=q.copy())
    monkeypatch.setattr("planning.handling.recovery.free_motion", lambda *_: NoMotion("walled in"))
    assert not Recovery(Executor(robot), Layout(), ways_out=0).go_home(np.random.default_rng(0))
    np.testing.assert_array_equal(robot.q, q)
