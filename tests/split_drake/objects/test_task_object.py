"""Objects and where the poses of their tasks are."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from split_drake.objects.mugs.split import load_mug
from split_drake.objects.task_object import TaskObject
from split_drake.pose_task import (
    GRASP,
    HANDLE,
    UPRIGHT,
    Axis,
    PoseTask,
    Symmetry,
    UnknownTaskError,
)
from split_drake.poses import make_pose, rotation_x, rotation_z

X_WO = make_pose(rotation_z(0.7) @ rotation_x(0.4), (0.5, 0.02, 0.1))
X_OPs = make_pose(rotation_x(0.3), [(0.0, 0.0, 0.1), (0.1, 0.0, 0.0)])


def with_task(symmetry: Symmetry) -> tuple[TaskObject, PoseTask]:
    """Return an object with two poses of a task of its own."""
    task = PoseTask("hold", symmetry)
    return TaskObject(body=load_mug("test_000").body, X_OPs={task: X_OPs}), task


@pytest.mark.parametrize("symmetry", [Symmetry(), Symmetry.any_turn("y")])
def test_true_poses_are_where_the_object_is(symmetry: Symmetry) -> None:
    subject, task = with_task(symmetry)
    np.testing.assert_allclose(subject.true_poses(task, X_WO), X_WO @ X_OPs)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_both_poses_that_a_half_turn_makes_equal_are_true(axis: Axis) -> None:
    subject, task = with_task(Symmetry.half_turn(axis))
    first, turned = np.split(subject.true_poses(task, X_WO), 2)
    np.testing.assert_allclose(first, X_WO @ X_OPs)
    np.testing.assert_allclose(turned, first @ task.symmetry.X_half_turn)


def test_mugs_have_a_handle_and_stand_in_their_own_frame() -> None:
    mug = load_mug("test_003")
    assert (mug.name, mug.split, mug.number, mug.mirrored) == ("test_003", "test", 3, True)
    assert set(mug.X_OPs) == {HANDLE, UPRIGHT}
    np.testing.assert_array_equal(mug.poses_of(HANDLE), mug.X_OH[None])
    np.testing.assert_array_equal(mug.poses_of(UPRIGHT), np.eye(4)[None])


def test_an_object_of_no_task_has_no_poses_and_no_feature() -> None:
    plain = TaskObject(body=load_mug("test_000").body)
    assert plain.feature() is None
    with pytest.raises(UnknownTaskError, match=r"test_000 has no poses of .*of no task"):
        plain.poses_of(HANDLE)


def test_tasks_without_poses_are_refused_and_those_known_named() -> None:
    with pytest.raises(UnknownTaskError, match=r"grasp.*it has those of handle, upright"):
        load_mug("test_000").true_poses(GRASP, X_WO)


def test_objects_have_draws_of_their_own_whatever_set_they_are_in() -> None:
    body = load_mug("test_003").body
    assert load_mug("test_003").seed == (3, 1)
    assert load_mug("train_003").seed == (3, 0)
    ones = [
        TaskObject(body=replace(body, name=name), split=split)
        for name, split in product(("one", "two"), ("", "validation"))
    ]
    assert len({one.seed for one in ones}) == 4
    assert ones[0].seed == TaskObject(body=replace(body, name="one"), number=7).seed
