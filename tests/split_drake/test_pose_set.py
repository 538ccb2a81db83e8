"""Pose sets and their files."""

from pathlib import Path

import numpy as np
import pytest

from split_drake.pose_set import PoseSet, load_pose_sets, save_pose_sets
from split_drake.pose_task import PoseTask
from split_drake.poses import make_pose


def poses(count: int) -> np.ndarray:
    return make_pose(p=np.arange(3.0 * count).reshape(count, 3))


def test_ranked_sorts_best_first_and_keeps_ties_in_order() -> None:
    ranked = PoseSet.ranked(PoseTask.GRASP, poses(4), np.array([0.5, 0.9, 0.5, 1.0]))
    np.testing.assert_array_equal(ranked.scores, [1.0, 0.9, 0.5, 0.5])
    np.testing.assert_array_equal(ranked.X_WPs[:, 0, 3], [9.0, 3.0, 0.0, 6.0])


def test_head_takes_the_best() -> None:
    pose_set = PoseSet.ranked(PoseTask.HANDLE, poses(3), np.array([0.1, 0.2, 0.3]))
    assert len(pose_set.head(2)) == 2
    assert pose_set.head(2).scores.min() == 0.2
    assert len(pose_set.head(9)) == 3


@pytest.mark.parametrize(
    ("X_WPs", "scores", "message"),
    [
        (poses(2), [0.5], "shape"),
        (poses(2), [0.5, 1.5], r"\[0, 1\]"),
        (poses(2), [0.5, np.nan], r"\[0, 1\]"),
        (poses(2), [0.1, 0.5], "descend"),
        (2.0 * poses(1), [0.5], "X_WPs"),
    ],
)
def test_bad_sets_are_refused(X_WPs: np.ndarray, scores: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PoseSet(PoseTask.GRASP, X_WPs, np.array(scores))


def test_an_empty_set_is_a_set() -> None:
    assert len(PoseSet(PoseTask.GRASP, np.zeros((0, 4, 4)), np.zeros(0))) == 0


def test_saved_sets_come_back(tmp_path: Path) -> None:
    sets = {
        PoseTask.GRASP: PoseSet(PoseTask.GRASP, poses(3), np.array([0.9, 0.8, 0.7])),
        PoseTask.UPRIGHT: PoseSet(PoseTask.UPRIGHT, np.zeros((0, 4, 4)), np.zeros(0)),
    }
    cloud = np.random.default_rng(0).normal(size=(10, 3))
    path = tmp_path / "new folder" / "poses.npz"
    save_pose_sets(path, sets, cloud)
    loaded, loaded_cloud = load_pose_sets(path)
    assert set(loaded) == set(sets)
    np.testing.assert_array_equal(loaded[PoseTask.GRASP].X_WPs, poses(3))
    np.testing.assert_allclose(loaded_cloud, cloud, atol=1e-6)
    assert [file.name for file in path.parent.iterdir()] == ["poses.npz"]


def test_a_foreign_archive_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", weights=np.zeros(3))
    with pytest.raises(ValueError, match="weights"):
        load_pose_sets(tmp_path / "other.npz")
