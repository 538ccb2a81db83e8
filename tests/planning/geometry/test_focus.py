"""One object of several in view."""

import numpy as np
import pytest

from planning.geometry.focus import filled_down, focus_on_one
from planning.subgoal import find_subgoal
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT
from split_drake.poses import make_pose
from tests.helpers.clutter import box_cloud
from tests.helpers.planning import LYING, STANDING, mug_problem

HANG = find_subgoal("hang")
AWAY = make_pose(p=(0.13, 0.04, 0.0))


def test_poses_and_points_of_the_most_promising_object_are_kept() -> None:
    here, there = mug_problem(HANG, STANDING), mug_problem(HANG, AWAY @ STANDING)
    both = {
        name: PoseSet(
            poses.task,
            np.concatenate([poses.X_WPs, there.pose_sets[name].X_WPs]),
            np.ones(len(poses) + len(there.pose_sets[name])),
        )
        for name, poses in here.pose_sets.items()
    }
    handles = both["handle"]
    better = np.where(np.arange(len(handles)) >= len(handles) // 2, 0.9, 0.8)
    both["handle"] = PoseSet.ranked(HANDLE, handles.X_WPs, better)
    cloud = np.concatenate([here.p_WPs, there.p_WPs])
    focus = focus_on_one(cloud, both, HANG.tasks)
    assert focus.in_view == 2
    assert len(focus.p_WPs) == len(there.p_WPs)
    assert len(focus.p_WObstacles) == len(here.p_WPs)
    middle = there.p_WPs[:, :2].mean(axis=0)
    for name, poses in focus.pose_sets.items():
        assert len(poses) == len(there.pose_sets[name])
        assert np.linalg.norm(poses.X_WPs[:, :2, 3] - middle, axis=1).max() < 0.09


def test_an_object_without_poses_of_all_tasks_is_not_preferred() -> None:
    here, beside = mug_problem(HANG, STANDING), box_cloud((0.62, 0.08), (0.04, 0.04, 0.06))
    X_WGbox = make_pose(p=(0.62, 0.08, 0.05))[None]
    grasps = PoseSet.ranked(
        GRASP,
        np.concatenate([here.pose_sets["grasp"].X_WPs, X_WGbox]),
        np.append(np.full(len(here.pose_sets["grasp"]), 0.5), 1.0),
    )
    focus = focus_on_one(
        np.concatenate([here.p_WPs, beside]), {**here.pose_sets, "grasp": grasps}, HANG.tasks
    )
    assert len(focus.pose_sets["grasp"]) == len(here.pose_sets["grasp"])
    assert len(focus.p_WObstacles) == len(beside)


@pytest.mark.parametrize("X_WO", [STANDING, LYING], ids=["standing", "lying"])
def test_a_lone_object_keeps_all_that_was_found(X_WO: np.ndarray) -> None:
    problem = mug_problem(HANG, X_WO)
    focus = focus_on_one(problem.p_WPs, problem.pose_sets, HANG.tasks)
    assert focus.in_view == 1
    assert focus.p_WPs is problem.p_WPs
    assert dict(focus.pose_sets) == dict(problem.pose_sets)
    assert focus.p_WObstacles.shape == (0, 3)


def test_what_stands_is_solid_below_what_is_seen() -> None:
    top = box_cloud((0.5, 0.0), (0.05, 0.05, 0.10))
    top = top[top[:, 2] > 0.09]
    points = filled_down(top, 0.0)
    assert points[:, 2].min() < 0.01
    low = points[points[:, 2] < 0.05]
    assert np.abs(low[:, :2] - (0.5, 0.0)).max() < 0.03
    assert (np.linalg.norm(low[:, :2] - (0.5, 0.0), axis=1) < 0.008).any(), "inside, too"
    assert filled_down(np.empty((0, 3)), 0.0).shape == (0, 3)


def test_upright_poses_are_told_apart_by_where_objects_stand() -> None:
    here, there = mug_problem(HANG, STANDING), mug_problem(HANG, AWAY @ STANDING)
    uprights = PoseSet(UPRIGHT, np.stack([STANDING, AWAY @ STANDING]), np.array([0.9, 0.8]))
    cloud = np.concatenate([here.p_WPs, there.p_WPs])
    focus = focus_on_one(cloud, {**here.pose_sets, "upright": uprights}, HANG.tasks)
    np.testing.assert_array_equal(focus.pose_sets["upright"].X_WPs, STANDING[None])
