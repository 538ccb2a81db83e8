"""Tasks as values, and which poses mean the same."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import cast

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from split_drake.pose_task import (
    GRASP,
    HANDLE,
    MUG_TASKS,
    UPRIGHT,
    Axis,
    PoseTask,
    Symmetry,
    SymmetryKind,
    UnknownTaskError,
    find_tasks,
)
from split_drake.poses import (
    Array,
    make_pose,
    rotation_error_rad,
    rotation_x,
    rotation_y,
    rotation_z,
)

AXES: tuple[Axis, ...] = ("x", "y", "z")
ROTATIONS: dict[Axis, Callable[[float], Array]] = {
    "x": rotation_x,
    "y": rotation_y,
    "z": rotation_z,
}
SYMMETRIES = (
    Symmetry(),
    *(Symmetry.half_turn(axis) for axis in AXES),
    *(Symmetry.any_turn(axis) for axis in AXES),
)
# arccos loses half the digits near 0 and pi.
ANGLE_TOLERANCE_RAD = 1e-6

seeds = st.integers(0, 2**32 - 1)
symmetries = st.sampled_from(SYMMETRIES)
axes = st.sampled_from(AXES)
angles = st.floats(-np.pi, np.pi)


def random_poses(rng: np.random.Generator, count: int) -> Array:
    rotations = Rotation.random(count, random_state=rng).as_matrix()
    return make_pose(rotations, rng.normal(size=(count, 3)))


def equal_turns(symmetry: Symmetry, rng: np.random.Generator, count: int = 20) -> Array:
    """Return turns (N, 4, 4) after which a pose means the same, the half turn among them."""
    if symmetry.axis is None:
        return np.eye(4)[None]
    angles_rad = np.array([0.0, np.pi])
    if symmetry.kind == "any turn":
        angles_rad = np.append(angles_rad, rng.uniform(-np.pi, np.pi, count))
    return make_pose(np.stack([ROTATIONS[symmetry.axis](angle) for angle in angles_rad]))


def is_equal_turn(symmetry: Symmetry, R: Array) -> bool:
    """Return whether a pose turned by R (3, 3) means the same."""
    if symmetry.kind == "any turn":
        axis = np.eye(3)[symmetry.column]
        return np.allclose(R @ axis, axis)
    return np.allclose(R, np.eye(3)) or np.allclose(R, symmetry.X_half_turn[:3, :3])


@given(symmetries, seeds)
def test_the_nearest_pose_means_the_same_at_the_same_place(symmetry: Symmetry, seed: int) -> None:
    *X_WPs, X_WP = random_poses(np.random.default_rng(seed), 6)
    for before, after in zip(X_WPs, symmetry.nearest(X_WPs, X_WP), strict=True):
        np.testing.assert_allclose(after[:, 3], before[:, 3], atol=1e-12)
        assert is_equal_turn(symmetry, before[:3, :3].T @ after[:3, :3])


@given(symmetries, seeds)
def test_no_pose_that_means_the_same_is_nearer(symmetry: Symmetry, seed: int) -> None:
    rng = np.random.default_rng(seed)
    *X_WPs, X_WP = random_poses(rng, 4)
    nearest = rotation_error_rad(symmetry.nearest(X_WPs, X_WP)[:, :3, :3], X_WP[:3, :3])
    others = np.stack(X_WPs)[:, None] @ equal_turns(symmetry, rng)
    errors = rotation_error_rad(others[..., :3, :3], X_WP[:3, :3])
    assert (nearest[:, None] <= errors + ANGLE_TOLERANCE_RAD).all()


@given(symmetries, seeds)
def test_the_error_is_that_of_the_nearest_pose(symmetry: Symmetry, seed: int) -> None:
    *X_WPs, X_WP = random_poses(np.random.default_rng(seed), 6)
    nearest = rotation_error_rad(symmetry.nearest(X_WPs, X_WP)[:, :3, :3], X_WP[:3, :3])
    errors = symmetry.rotation_error_rad(np.stack(X_WPs)[:, :3, :3], X_WP[:3, :3])
    np.testing.assert_allclose(errors, nearest, atol=ANGLE_TOLERANCE_RAD)


@given(symmetries, seeds)
def test_errors_are_the_same_both_ways(symmetry: Symmetry, seed: int) -> None:
    R_A, R_B = random_poses(np.random.default_rng(seed), 2)[:, :3, :3]
    there, back = symmetry.rotation_error_rad(R_A, R_B), symmetry.rotation_error_rad(R_B, R_A)
    assert there == pytest.approx(float(back), abs=ANGLE_TOLERANCE_RAD)


@given(symmetries, seeds)
def test_errors_do_not_depend_on_which_of_equal_poses_is_meant(
    symmetry: Symmetry, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    R_A, R_B = random_poses(rng, 2)[:, :3, :3]
    turns = equal_turns(symmetry, rng)[:, :3, :3]
    errors = symmetry.rotation_error_rad((R_A @ turns)[:, None], R_B @ turns)
    assert errors.shape == (len(turns), len(turns))
    expected = float(symmetry.rotation_error_rad(R_A, R_B))
    np.testing.assert_allclose(errors, expected, atol=ANGLE_TOLERANCE_RAD)


@given(symmetries, seeds)
def test_there_is_no_error_between_equal_poses(symmetry: Symmetry, seed: int) -> None:
    rng = np.random.default_rng(seed)
    R_A = random_poses(rng, 1)[0, :3, :3]
    errors = symmetry.rotation_error_rad(R_A @ equal_turns(symmetry, rng)[:, :3, :3], R_A)
    assert errors.max() <= ANGLE_TOLERANCE_RAD


@given(axes, angles)
def test_turns_about_the_axis_count_up_to_what_means_the_same(axis: Axis, angle: float) -> None:
    R, size = ROTATIONS[axis](angle), abs(angle)
    expected = {
        Symmetry(): size,
        Symmetry.half_turn(axis): min(size, np.pi - size),
        Symmetry.any_turn(axis): 0.0,
    }
    for symmetry, error_rad in expected.items():
        found = symmetry.rotation_error_rad(R, np.eye(3))
        assert found == pytest.approx(error_rad, abs=ANGLE_TOLERANCE_RAD)


@given(axes, axes, angles)
def test_turns_about_other_axes_count_in_full(axis: Axis, other: Axis, angle: float) -> None:
    assume(axis != other)
    found = Symmetry.any_turn(axis).rotation_error_rad(ROTATIONS[other](angle), np.eye(3))
    assert found == pytest.approx(abs(angle), abs=ANGLE_TOLERANCE_RAD)


@pytest.mark.parametrize("axis", AXES)
def test_where_the_axes_are_opposite_all_turns_are_as_far(axis: Axis) -> None:
    symmetry, other = Symmetry.any_turn(axis), "y" if axis == "x" else "x"
    X_WP = make_pose(ROTATIONS[cast(Axis, other)](np.pi))
    nearest = symmetry.nearest(np.eye(4)[None], X_WP)
    assert is_equal_turn(symmetry, nearest[0, :3, :3])
    found = symmetry.rotation_error_rad(np.eye(3), X_WP[:3, :3])
    assert found == pytest.approx(np.pi, abs=ANGLE_TOLERANCE_RAD)


def test_no_poses_have_no_nearest() -> None:
    for symmetry in SYMMETRIES:
        assert symmetry.nearest(np.zeros((0, 4, 4)), np.eye(4)).shape == (0, 4, 4)


@pytest.mark.parametrize("axis", AXES)
def test_half_turns_are_exact(axis: Axis) -> None:
    X = Symmetry.half_turn(axis).X_half_turn
    assert np.array_equal(X @ X, np.eye(4))
    np.testing.assert_allclose(X[:3, :3], ROTATIONS[axis](np.pi), atol=1e-12)
    assert np.array_equal(Symmetry().X_half_turn, np.eye(4))


@pytest.mark.parametrize("axis", AXES)
def test_the_column_is_that_of_the_axis(axis: Axis) -> None:
    assert AXES[Symmetry.half_turn(axis).column] == axis
    with pytest.raises(ValueError, match="no axis"):
        _ = Symmetry().column


def test_unknown_kinds_are_refused() -> None:
    with pytest.raises(ValueError, match="symmetry is 'quarter turn'; expected"):
        Symmetry(cast(SymmetryKind, "quarter turn"), "z")


@pytest.mark.parametrize(
    ("kind", "axis"),
    [
        ("half turn", None),
        ("any turn", None),
        ("none", "z"),
        ("half turn", cast(Axis, "w")),
        ("any turn", cast(Axis, "")),
    ],
)
def test_axes_that_do_not_go_with_the_kind_are_refused(
    kind: SymmetryKind, axis: Axis | None
) -> None:
    with pytest.raises(ValueError, match=f"the axis of symmetry '{kind}' is {axis!r}; expected"):
        Symmetry(kind, axis)


@pytest.mark.parametrize("name", ["", "Grasp", "2nd", "_rim", "two words", "a/b", "a-b", "grasp\n"])
def test_names_of_other_characters_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"a task is called .*; expected lower-case letters"):
        PoseTask(name)


def test_a_task_is_a_value_known_by_its_name() -> None:
    spout = PoseTask("spout_2", Symmetry.any_turn("x"), "where tea comes out, along x")
    assert str(spout) == "spout_2"
    assert spout == replace(spout)
    assert spout != replace(spout, symmetry=Symmetry())
    assert {spout: 1}[replace(spout)] == 1


@pytest.mark.parametrize("task", [*MUG_TASKS, PoseTask("lid")], ids=str)
def test_tasks_come_back_from_json(task: PoseTask) -> None:
    assert PoseTask.from_fields(json.loads(json.dumps(asdict(task)))) == task


def test_tasks_are_found_by_value_or_name_in_the_order_asked_for() -> None:
    assert find_tasks(("upright", GRASP), MUG_TASKS, "the mug") == (UPRIGHT, GRASP)
    assert find_tasks((), MUG_TASKS, "the mug") == ()


def test_other_words_for_the_same_frame_are_the_same_task() -> None:
    (found,) = find_tasks([replace(HANDLE, frame="the handle")], MUG_TASKS, "the mug")
    assert found is HANDLE


def test_unknown_tasks_are_refused_and_those_known_named() -> None:
    with pytest.raises(
        UnknownTaskError, match=r"the mug has no task 'lid'; it has grasp, handle, upright$"
    ):
        find_tasks((GRASP, "lid"), MUG_TASKS, "the mug")


def test_a_single_name_is_no_sequence_of_tasks() -> None:
    with pytest.raises(
        TypeError, match=r"^tasks are 'top'; expected a sequence, such as \['top'\]$"
    ):
        find_tasks("top", MUG_TASKS, "the mug")


def test_a_task_of_another_symmetry_is_another_task() -> None:
    turning = PoseTask("upright", Symmetry.any_turn("z"))
    with pytest.raises(UnknownTaskError, match=r"'upright' has .*'any turn'.*the mug has .*'none'"):
        find_tasks((turning,), MUG_TASKS, "the mug")
