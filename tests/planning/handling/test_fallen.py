"""A look after the release tells whether the object lies on the table."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planning.handling.attempts import AttemptLimits, Perception
from planning.handling.fallen import fallen_object
from planning.problem import Plan, Stage
from split_drake.camera import DepthView
from split_drake.data.render import DepthRenderer
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import Array, make_pose, rotation_x, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import Layout
from tests.helpers.handling import WIDTH_M, Placer, catch, handle
from tests.helpers.planning import STANDING, hang_plan, mug_cloud, reorient_plan
from tests.helpers.robot import PerfectRobot

LAYOUT, NOTHING = Layout(), np.empty((0, 3))


@cache
def views(x_m: float, y_m: float, z_m: float, lying: bool) -> tuple[DepthView, ...]:
    renderer = DepthRenderer(load_mug("train_003").body.mesh)
    R = rotation_x(np.pi / 2.0) if lying else np.eye(3)
    X_WO = make_pose(R, (x_m, y_m, z_m))
    return tuple(renderer.render(X_WO, camera) for camera in LAYOUT.cameras)


class SeeingRobot(PerfectRobot):
    """Sees a mug somewhere, and nothing else."""

    def __init__(self, shown: tuple[DepthView, ...], plan: Plan | None = None) -> None:
        super().__init__(WIDTH_M)
        self.shown = shown
        if plan is not None:
            self.q = plan.segments[-1].trajectory.qs[-1]

    def capture(self) -> tuple[DepthView, ...]:
        return self.shown


FALLEN, HANGING = (0.47, -0.30, 0.045, True), (0.5, -0.38, 0.27, False)


def look(
    shown: tuple[DepthView, ...],
    plan: Plan | None = None,
    before: tuple[DepthView, ...] = (),
    p_WOthers: Array = NOTHING,
) -> Array | None:
    plan, p_WPs = plan or hang_plan(), transform_points(STANDING, mug_cloud())
    scene = Scene.from_points(p_WPs, Workspace(), before)
    perception = Perception(scene, {}, p_WPs, p_WOthers, in_view=1, duration_s=0.1)
    return fallen_object(SeeingRobot(shown, plan), LAYOUT, plan, perception)


def test_what_lies_on_the_table_has_fallen() -> None:
    found = look(views(*FALLEN))
    assert found is not None
    np.testing.assert_allclose(found[:2], FALLEN[:2], atol=0.06)


def test_what_hangs_has_not_fallen() -> None:
    assert look(views(*HANGING)) is None


def test_what_stood_there_before_has_not_fallen() -> None:
    others = np.concatenate([view.points(0.004) for view in views(*FALLEN)])
    assert look(views(*FALLEN), p_WOthers=others) is None
    assert look(views(*FALLEN), before=views(*FALLEN)) is None


def test_where_the_object_was_itself_it_may_have_fallen_back() -> None:
    back = (float(STANDING[0, 3]), float(STANDING[1, 3]), 0.0, False)
    found = look(views(*back), before=views(*back))
    assert found is not None
    np.testing.assert_allclose(found[:2], back[:2], atol=0.03)


def test_a_few_points_are_no_object() -> None:
    thinned = []
    for view in views(*FALLEN):
        depth_m = np.zeros_like(view.depth_m)
        depth_m[::16, ::16] = view.depth_m[::16, ::16]
        thinned.append(replace(view, depth_m=depth_m))
    assert look(tuple(thinned)) is None


def test_where_the_goal_is_on_the_table_nothing_can_be_told() -> None:
    assert look(views(*FALLEN), reorient_plan()) is None


@pytest.mark.parametrize("looks_after", [True, False])
def test_an_object_that_fell_is_left_there_and_told(looks_after: bool) -> None:
    limits = AttemptLimits(held_views=False, looks_after=looks_after)
    robot = SeeingRobot(views(*FALLEN))
    handled = handle(robot, Placer(), limits=limits, plan=hang_plan())
    (attempt,) = handled.attempts
    if looks_after:
        stage, reason = attempt.failure
        assert stage is Stage.PLACEMENT and "fell: something lies at (0.4" in reason
        assert attempt.recovery == "left it there" and handled.home
        np.testing.assert_allclose(robot.q, LAYOUT.q_home, atol=1e-6)
    else:
        assert attempt.failure == (None, "") and not handled.home


def test_what_the_hand_that_was_caught_dragged_off_is_told() -> None:
    robot = SeeingRobot(views(*FALLEN))
    limits = AttemptLimits(held_views=False)
    qs = hang_plan().segments[-1].trajectory.qs
    back_W = gripper_pose(qs[-1])[:3, 3] - gripper_pose(qs[0])[:3, 3]
    back_W /= np.linalg.norm(back_W)
    aside_W = np.cross(back_W, (0.0, 0.0, 1.0))
    slope_W = 0.8 * aside_W / np.linalg.norm(aside_W) - 0.6 * back_W
    handled = handle(robot, Placer(), catch(robot, tuple(slope_W)), limits, hang_plan())
    (attempt,) = handled.attempts
    assert attempt.recovery == "eased the hand out" and handled.home
    stage, reason = attempt.failure
    assert stage is Stage.PLACEMENT and "the object fell" in reason


def test_an_object_that_hangs_is_done_with() -> None:
    handled = handle(
        SeeingRobot(views(*HANGING)),
        Placer(),
        limits=AttemptLimits(held_views=False),
        plan=hang_plan(),
    )
    assert [attempt.failure for attempt in handled.attempts] == [(None, "")]
