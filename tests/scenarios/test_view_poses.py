"""Saved pose sets as pages."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.view_poses import ViewOptions, main
from scenarios.viewing.pose_drawing import pose_segments, score_bands, score_color
from split_drake.pose_set import PoseSet, save_pose_sets
from split_drake.pose_task import PoseTask
from split_drake.poses import make_pose, rotation_z


def test_sketches_move_with_their_poses() -> None:
    X_WP = make_pose(rotation_z(0.5), (1.0, 2.0, 3.0))
    at_origin = pose_segments(PoseTask.GRASP, np.eye(4))
    moved = pose_segments(PoseTask.GRASP, X_WP)
    np.testing.assert_allclose(moved, at_origin @ X_WP[:3, :3].T + X_WP[:3, 3], atol=1e-12)


def test_bands_hold_every_pose_once() -> None:
    scores = np.array([0.0, 0.19, 0.5, 0.99, 1.0])
    pose_set = PoseSet.ranked(PoseTask.UPRIGHT, make_pose(p=np.zeros((5, 3))), scores)
    sketch = len(pose_segments(PoseTask.UPRIGHT, np.eye(4)))
    bands = list(score_bands(pose_set))
    assert [len(band.segments_W) // sketch for band in bands] == [2, 1, 2]
    assert bands[-1].color == score_color(0.9)


def test_a_saved_set_becomes_a_page(tmp_path: Path) -> None:
    pose_set = PoseSet.ranked(PoseTask.GRASP, np.eye(4)[None], np.array([0.7]))
    cloud = np.random.default_rng(0).normal(size=(50, 3))
    save_pose_sets(tmp_path / "poses.npz", {PoseTask.GRASP: pose_set}, cloud)
    page = main(ViewOptions(tmp_path / "poses.npz"))
    text = page.read_text()
    assert page == tmp_path / "poses.html"
    assert text.lstrip().lower().startswith("<!doctype html>")
    assert len(text) > 100_000  # the viewer is inside


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        main(ViewOptions(tmp_path / "nowhere.npz"))
