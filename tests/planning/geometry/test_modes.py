"""Properties of modes: they cover all poses, and means do not depend on how a pose is written."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from planning.geometry.modes import (
    MODE_ANGLE_RAD,
    MODE_DISTANCE_M,
    away_from,
    distinct_modes,
    mode_means,
    modes_of,
)
from planning.geometry.perceived import best_upright
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask, Symmetry
from split_drake.poses import Array, make_pose

LID = PoseTask("lid", Symmetry.any_turn("z"))
seeds = st.integers(0, 2**32 - 1)
tasks = st.sampled_from((GRASP, HANDLE, UPRIGHT, LID))


def scattered(rng: np.random.Generator, middle: Array, count: int, spread: float) -> Array:
    """Return poses (N, 4, 4) around one, `spread` times as far off as poses of one mode may be."""
    turns = Rotation.from_rotvec(spread * MODE_ANGLE_RAD * rng.normal(size=(count, 3)) / 3.0)
    shifts = spread * MODE_DISTANCE_M * rng.normal(size=(count, 3)) / 3.0
    return make_pose(middle[:3, :3] @ turns.as_matrix(), middle[:3, 3] + shifts)


def equivalent(task: PoseTask, X: Array, rng: np.random.Generator) -> Array:
    """Return a pose that means the same."""
    if task.symmetry.kind == "any turn":
        turn = Rotation.from_rotvec(rng.uniform(-3.0, 3.0) * np.eye(3)[task.symmetry.column])
        return X @ make_pose(turn.as_matrix())
    return X @ task.symmetry.X_half_turn if rng.random() < 0.5 else X


def alike(task: PoseTask, X_WA: Array, X_WB: Array) -> bool:
    angle_rad = task.symmetry.rotation_error_rad(X_WA[:3, :3], X_WB[:3, :3])
    distance_m = np.linalg.norm(X_WA[:3, 3] - X_WB[:3, 3])
    return bool(distance_m < MODE_DISTANCE_M and angle_rad < MODE_ANGLE_RAD)


@given(seeds, tasks, st.integers(1, 12))
def test_modes_are_unlike_each_other_and_all_other_poses_like_a_better_one(
    seed: int, task: PoseTask, count: int
) -> None:
    X_WPs = scattered(np.random.default_rng(seed), make_pose(), 30, spread=3.0)
    every = distinct_modes(X_WPs, len(X_WPs), task.symmetry)
    for index in range(len(X_WPs)):
        better = [mode for mode in every if mode < index]
        like_one = any(alike(task, X_WPs[index], X_WPs[mode]) for mode in better)
        assert like_one == (index not in every)
    assert distinct_modes(X_WPs, count, task.symmetry) == every[:count]


@given(seeds, tasks)
def test_means_are_the_same_whichever_of_equal_poses_are_given(seed: int, task: PoseTask) -> None:
    rng = np.random.default_rng(seed)
    # Well within a mode, so that no pose lies on its edge.
    middle = make_pose(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-0.3, 0.3, 3))
    X_WPs = scattered(rng, middle, 8, spread=0.25)
    others = np.stack([equivalent(task, X, rng) for X in X_WPs])
    scores = np.sort(rng.uniform(0.1, 1.0, 8))[::-1]
    [(mean, score)] = mode_means(PoseSet(task, X_WPs, scores), 3)
    [(other, other_score)] = mode_means(PoseSet(task, others, scores), 3)
    assert score == other_score == scores[0]
    np.testing.assert_allclose(mean[:3, 3], other[:3, 3], atol=1e-12)
    assert task.symmetry.rotation_error_rad(mean[:3, :3], other[:3, :3]) < 1e-5


@given(seeds, tasks)
def test_more_failures_leave_no_more_poses(seed: int, task: PoseTask) -> None:
    rng = np.random.default_rng(seed)
    X_WPs = scattered(rng, make_pose(), 20, spread=6.0)
    failed = np.stack([equivalent(task, X, rng) for X in X_WPs[rng.permutation(20)[:4]]])
    left = [away_from(X_WPs, failed[:count], task.symmetry) for count in range(5)]
    assert left[0].all()
    for fewer, more in zip(left[1:], left[:-1], strict=True):
        assert (fewer <= more).all()
    assert not away_from(failed, failed, task.symmetry).any()


def test_a_lone_pose_is_a_fluke_where_a_larger_mode_is_nearly_as_good() -> None:
    rng = np.random.default_rng(0)
    many, elsewhere = scattered(rng, make_pose(), 99, 0.1), make_pose(p=(0.1, 0.0, 0.0))[None]

    def scores_of_modes(lone_score: float, count: int = 99) -> list[float]:
        scores = np.concatenate([np.full(count, 0.8), [lone_score]])
        poses = np.concatenate([many[:count], elsewhere])
        return [score for _, score in mode_means(PoseSet.ranked(GRASP, poses, scores), 3)]

    assert scores_of_modes(0.7) == [0.8]
    assert scores_of_modes(0.85) == [0.8]
    assert scores_of_modes(0.95) == [0.95, 0.8]
    assert scores_of_modes(0.7, count=9) == [0.8, 0.7]


def test_where_all_modes_are_small_none_is_a_fluke() -> None:
    poses = make_pose(p=np.column_stack([0.1 * np.arange(100), np.zeros(100), np.zeros(100)]))
    spread = PoseSet.ranked(GRASP, poses, np.linspace(0.9, 0.5, 100))
    assert len(modes_of(spread)) == 100
    assert len(modes_of(PoseSet(GRASP, poses, np.zeros(100)))) == 100
    assert modes_of(PoseSet(GRASP, np.empty((0, 4, 4)), np.empty(0))) == []


def test_the_best_upright_pose_is_no_fluke() -> None:
    rng = np.random.default_rng(1)
    standing = scattered(rng, make_pose(), 99, 0.1)
    on_its_rim = make_pose(np.diag([1.0, -1.0, -1.0]))[None]
    scores = np.append(np.full(99, 0.98), 0.99)
    uprights = PoseSet.ranked(UPRIGHT, np.concatenate([standing, on_its_rim]), scores)
    assert uprights.X_WPs[0][2, 2] < 0.0
    X_WU = best_upright({UPRIGHT.name: uprights})
    assert X_WU is not None and X_WU[2, 2] > 0.9
    assert best_upright({UPRIGHT.name: PoseSet(UPRIGHT, np.empty((0, 4, 4)), np.empty(0))}) is None
    assert best_upright({}) is None
