"""The evaluation of detectors against a data set's truth."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from split_drake.data.grasps import sample_grasps
from split_drake.data.mugs import load_mug, mug_names
from split_drake.pose_set import PoseTask
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z
from split_drake.split.detector import SamplerConfig, ScoredSamples
from split_drake.training.evaluate import EvaluateConfig, evaluate, judge_poses, metrics_table

HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


def test_poses_are_good_within_a_centimetre_and_fifteen_degrees_of_any_true_one() -> None:
    X_WH = make_pose(rotation_z(0.4), (0.5, 0.1, 0.05))
    offsets = [
        make_pose(rotation_x(np.radians(14.0)), (0.009, 0.0, 0.0)),
        make_pose(rotation_x(np.radians(16.0)), (0.0, 0.0, 0.0)),
        make_pose(p=(0.0, 0.011, 0.0)),
        HALF_TURN @ make_pose(rotation_y(np.radians(5.0)), (0.0, 0.0, 0.002)),
        make_pose(rotation_z(np.pi)),
    ]
    judgement = judge_poses(X_WH @ np.stack(offsets), np.stack([X_WH, X_WH @ HALF_TURN]))
    assert judgement.good.tolist() == [True, False, False, True, False]
    assert judgement.position_m == pytest.approx([0.009, 0.0, 0.011, 0.002, 0.0], abs=1e-9)
    degrees = np.degrees(judgement.rotation_rad)
    assert degrees == pytest.approx([14.0, 16.0, 0.0, 5.0, 180.0], abs=1e-4)


@dataclass
class OneMug:
    """Two scenes of a mug standing in the middle of the workspace; the second hides its handle."""

    mug_names: tuple[str, ...] = field(default_factory=lambda: mug_names("test")[:1])
    dataset_hash: str = "one"

    def __post_init__(self) -> None:
        mug = load_mug(self.mug_names[0])
        X_WO = make_pose(p=(0.5, 0.0, 0.0))
        self.mug_index = np.zeros(2, dtype=int)
        self.X_WOs = np.stack([X_WO, X_WO])
        self.clouds = np.full((2, 10, 3), 0.05)
        self.handles = np.stack([mug.handle_poses(X_WO)] * 2)
        self.uprights = self.X_WOs[:, None]
        self.handle_points = np.array([100, 0])
        labels = sample_grasps(mug, np.random.default_rng(0), positives=40, negatives=10)
        self.grasps = X_WO @ labels.X_OGs
        self.misses = X_WO @ make_pose(rotation_x(np.pi), (0.0, 0.0, 0.25))


class KnowingDetector:
    """Ranks the truth first in scenes whose handle shows, and last in the others."""

    def __init__(self, dataset: OneMug) -> None:
        self.config = SamplerConfig(samples=2, threshold=0.3)
        self._dataset = dataset
        self._calls = 0

    def sample(self, *_: object) -> dict[PoseTask, ScoredSamples]:
        """Return one true and one false pose for each task."""
        truth_first = self._calls == 0
        self._calls += 1
        scores = np.array([0.9, 0.2] if truth_first else [0.1, 0.2])
        true_poses = {
            PoseTask.GRASP: self._top_down_grasp(),
            PoseTask.HANDLE: self._dataset.handles[0, 1],
            PoseTask.UPRIGHT: self._dataset.uprights[0, 0],
        }
        return {
            task: ScoredSamples(np.stack([X_WP, self._dataset.misses]), scores)
            for task, X_WP in true_poses.items()
        }

    def _top_down_grasp(self) -> Array:
        """Return the true grasp that comes most from above."""
        return self._dataset.grasps[np.argmin(self._dataset.grasps[:, 2, 2])]


def test_shares_are_counted_by_rank_threshold_and_visibility(tmp_path: Path) -> None:
    dataset = OneMug()
    metrics = evaluate(
        KnowingDetector(dataset),  # type: ignore[arg-type]
        dataset,  # type: ignore[arg-type]
        EvaluateConfig(data=tmp_path, scenes=2),
        Console(quiet=True),
    )
    for task in PoseTask:
        summary = metrics[task]
        assert summary["top_good"] == 0.5
        assert summary["top_good_handle_visible"] == 1.0
        assert summary["top_good_handle_hidden"] == 0.0
        assert summary["samples_good"] == 0.5
        assert summary["kept_good"] == 1.0
        assert summary["none_kept"] == 0.5
    assert metrics["grasp"]["median_position_mm"] is None
    assert metrics["handle"]["median_position_mm"] > 50.0
    assert metrics["scenes_handle_visible"] == 1
    assert metrics_table(metrics).row_count == len(metrics["grasp"])
