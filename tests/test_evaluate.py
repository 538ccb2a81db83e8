"""The evaluation of detectors against a data set's truth."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from split_drake.data.grasps import sample_grasps
from split_drake.data.mugs import load_mug, mug_names
from split_drake.pose_set import PoseTask
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z
from split_drake.split.checkpoint import CheckpointInfo
from split_drake.split.detector import SamplerConfig, ScoredSamples
from split_drake.split.diffusion import LangevinConfig
from split_drake.split.network import SplitConfig
from split_drake.training.evaluate import (
    EvaluateConfig,
    evaluate,
    metrics_table,
    require_shippable,
    require_unseen,
)
from split_drake.training.judgement import Judgement, judge_poses, outcome

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

    def __len__(self) -> int:
        return len(self.mug_index)


@pytest.fixture(scope="module")
def dataset() -> OneMug:
    return OneMug()


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


def test_shares_are_counted_by_rank_threshold_and_visibility(
    dataset: OneMug, tmp_path: Path
) -> None:
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
    assert (metrics["seed"], metrics["noise_m"]) == (0, 0.005)
    assert metrics["sampler"]["langevin"]["temperature"] == LangevinConfig().temperature
    assert (metrics["sampler"]["samples"], metrics["sampler"]["threshold"]) == (2, 0.3)
    assert json.loads(json.dumps(metrics)) == metrics
    assert metrics_table(metrics).row_count == len(metrics["grasp"])


def test_a_rejected_pose_is_not_good_even_if_right() -> None:
    judgement = Judgement(np.array([True, False]), np.zeros(2), np.zeros(2))
    kept, rejected = (
        outcome(np.array([0.3, 0.2]), judgement, threshold, visible=True)
        for threshold in (0.25, 0.4)
    )
    assert (kept.top_good, kept.kept) == (True, 1)
    assert (rejected.top_good, rejected.kept) == (False, 0)


@pytest.mark.parametrize("scenes", [0, 3])
def test_there_must_be_as_many_scenes_as_asked_for(
    scenes: int, dataset: OneMug, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=f"scenes is {scenes}; expected 1 to the data's 2"):
        evaluate(
            KnowingDetector(dataset),  # type: ignore[arg-type]
            dataset,  # type: ignore[arg-type]
            EvaluateConfig(data=tmp_path, scenes=scenes),
            Console(quiet=True),
        )


def info(commit: str = "c0ffee", **changes: object) -> CheckpointInfo:
    """Return the provenance of a checkpoint trained on the data "train"."""
    provenance = CheckpointInfo(SplitConfig(), {}, 0, "train", commit, steps=1, scenes=8)
    return replace(provenance, **changes)


def test_figures_on_training_data_are_refused() -> None:
    require_unseen(info(), "test")
    with pytest.raises(SystemExit, match="trained on this data"):
        require_unseen(info(), "train")
    with pytest.raises(SystemExit, match="trained on this data"):
        require_unseen(info(parent={"dataset_hash": "test"}), "test")


def test_checkpoints_of_unknown_source_are_not_shipped() -> None:
    require_shippable(info(), allow_dirty=False)
    require_shippable(info("c0ffee-dirty"), allow_dirty=True)
    with pytest.raises(SystemExit, match="differed from its commit, c0ffee-dirty"):
        require_shippable(info("c0ffee-dirty"), allow_dirty=False)
    with pytest.raises(SystemExit, match="unknown"):
        require_shippable(info(earlier_commits=("unknown",)), allow_dirty=True)
