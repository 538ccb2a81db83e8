"""Grasps that a model draws are tried in physics, and teach its evaluator alone."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from split_drake.data.mug_scenes import MugScene
from split_drake.grasps.free_hand import Hold
from split_drake.grasps.judge import GraspJudge
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import PoseTask
from split_drake.poses import Array, make_pose, rotation_x
from split_drake.scene import Scene
from split_drake.split.checkpoint import CheckpointInfo, load_checkpoint, save_checkpoint
from split_drake.split.detector import ScoredSamples
from split_drake.split.network import SplitNetwork
from split_drake.tuning import judged_grasps, tune_evaluator
from split_drake.tuning.evaluator_tuning import (
    JudgedScenes,
    TuneConfig,
    ranking_quality,
    tune_steps,
)
from split_drake.tuning.judged_grasps import JudgeConfig, JudgedGrasps, JudgedGraspsError
from tests.helpers.training import BATCH, FIRM_M, NETWORK, make_scenes, scenes_on_cpu


def judged_posts() -> JudgedGrasps:
    """Return grasps of posts: every other one at the top, and the rest, which do not hold, beside.

    There are 20 scenes of 10 mugs.
    """
    scenes = make_scenes(20)
    sideways_m = np.array([0.0, 0.05] * 4)
    zeros = np.zeros(8)
    X_OGs = make_pose(p=np.column_stack([zeros, sideways_m, zeros + FIRM_M]))
    return JudgedGrasps(
        clouds=scenes.clouds,
        sampled=(scenes.X_WOs[:, None] @ X_OGs).astype(np.float32),
        held=np.tile(sideways_m == 0.0, (20, 1)),
        mug_index=np.arange(20) // 2,
        mugs=10,
    )


def new_network() -> SplitNetwork:
    """Return a network that has learnt nothing."""
    torch.manual_seed(0)
    return SplitNetwork(NETWORK).eval()


@pytest.fixture
def config(tmp_path: Path) -> TuneConfig:
    return TuneConfig(
        judged=tmp_path / "judged",
        data=tmp_path / "posts",
        init=tmp_path / "init.safetensors",
        out=tmp_path / "tuned.safetensors",
        steps=60,
        learning_rate=3e-3,
        batch=replace(BATCH, grasps=0),
    )


def test_tuning_teaches_which_grasps_hold_and_nothing_else(config: TuneConfig) -> None:
    network = new_network()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    used, held_out = JudgedScenes.split(judged_posts())
    assert (len(used), len(held_out)) == (18, 2)
    losses = list(tune_steps(network, scenes_on_cpu(), used, config))
    assert np.mean(losses[-10:]) < 0.7 * np.mean(losses[:10])
    quality = ranking_quality(network, held_out)
    assert quality["holds"] == 0.5
    assert quality["top_holds"] == 1.0
    assert quality["auc"] > 0.9
    for name, value in network.state_dict().items():
        assert torch.equal(value, before[name]) != name.startswith("evaluator_"), name


def test_the_tuned_checkpoint_says_where_it_comes_from(
    config: TuneConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        tune_evaluator.MugDataset, "open", staticmethod(lambda folder: make_scenes())
    )
    monkeypatch.setattr(JudgedGrasps, "open", lambda folder, names: judged_posts())
    info = CheckpointInfo(NETWORK, {}, 0, "post", "abc", steps=7, scenes=56)
    save_checkpoint(config.init, new_network(), info)
    tune_evaluator.tune(replace(config, steps=2))
    _, tuned = load_checkpoint(config.out)
    assert (tuned.steps, tuned.scenes, tuned.dataset_hash) == (2, 16, "post")
    assert tuned.parent is not None
    assert (tuned.parent["commit"], tuned.parent["steps"]) == ("abc", 7)
    assert tuned.metrics["tuning"]["before"]["holds"] == 0.5


def test_too_few_mugs_and_unjudged_grasps_are_errors(config: TuneConfig) -> None:
    posts = judged_posts()
    few = replace(posts, mug_index=posts.mug_index % 9, mugs=9)
    with pytest.raises(ValueError, match="9 mugs; expected at least 10"):
        JudgedScenes.split(few)
    with pytest.raises(ValueError, match=r"batch\.grasps is 8; expected 0"):
        replace(config, batch=BATCH)


class DetectorOfTwo:
    """Detects a grasp above the mug's middle, and one below the table."""

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, ScoredSamples]:
        middle = scene.p_WSs.mean(axis=0)
        p_WGs = np.stack([[middle[0], middle[1], 0.3], [middle[0], middle[1], -0.1]])
        X_WGs = make_pose(np.stack([rotation_x(np.pi)] * 2), p_WGs)
        return {PoseTask.GRASP: ScoredSamples(X_WGs, np.array([0.5, 0.5]))}


class HandThatHoldsAll:
    """Stands in for physics; remembers what it was asked to try."""

    def __init__(self) -> None:
        self.heights_m: list[float] = []

    def hold_in_scene(self, X_WO: Array, X_WG: Array, opening_m: float) -> Hold:
        self.heights_m.append(X_WG[2, 3])
        return Hold("", 0.0, 0.0)


def test_grasps_are_tried_where_the_hand_can_go() -> None:
    shape, cloud = load_mug("train_003"), make_scenes().clouds[0].astype(float)
    scene = MugScene(make_pose(p=(0.5, 0.0, 0.0)), cloud, cloud, 0, 2, 0.0)
    hand = HandThatHoldsAll()
    judge = GraspJudge(shape.body.mesh)
    mug = SimpleNamespace(draw=lambda rng: scene, judge=judge, hand=hand)
    drawn = judged_grasps.judge_scene(mug, DetectorOfTwo(), np.random.default_rng(0))  # type: ignore[arg-type]
    assert drawn["held"].tolist() == [True, False]
    assert hand.heights_m == [0.3], "the hand cannot go below the table"
    assert drawn["clouds"].dtype == drawn["sampled"].dtype == np.float32
    assert np.allclose(drawn["clouds"], cloud), "what is kept has no noise"


@pytest.fixture
def judging(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> JudgeConfig:
    """Return a configuration whose scenes are posts, drawn by nothing."""
    posts = judged_posts()
    scene = {"clouds": posts.clouds[0], "sampled": posts.sampled[0], "held": posts.held[0]}
    monkeypatch.setattr(judged_grasps, "judge_scene", lambda mug, detector, rng: scene)
    monkeypatch.setattr(judged_grasps.EvalMug, "of_split", lambda name: None)
    checkpoint = tmp_path / "split.safetensors"
    info = CheckpointInfo(NETWORK, {}, 0, "post", "abc", steps=7, scenes=56)
    save_checkpoint(checkpoint, new_network(), info)
    (tmp_path / "judged").mkdir()
    return JudgeConfig(checkpoint=checkpoint, out=tmp_path / "judged", scenes_per_mug=3, workers=1)


def test_judged_grasps_are_kept_by_mug(judging: JudgeConfig) -> None:
    names = ["train_000", "train_001"]
    for name in names:
        judged_grasps.write_judged(judging, name)
    read = JudgedGrasps.open(judging.out, names)
    assert read.clouds.shape == (6, 2000, 3)
    assert read.sampled.shape == (6, 8, 4, 4)
    assert read.held.tolist() == [judged_posts().held[0].tolist()] * 6
    assert (read.mug_index.tolist(), read.mugs) == ([0, 0, 0, 1, 1, 1], 2)
    with pytest.raises(JudgedGraspsError, match=r"1 of 3 shards are missing, .*train_007\.npz"):
        JudgedGrasps.open(judging.out, [*names, "train_007"])


def test_judging_goes_on_only_where_it_was_the_same(judging: JudgeConfig) -> None:
    judged_grasps.write_judged(judging, "train_000")
    shard = judging.out / "train_000.npz"
    before = shard.stat().st_mtime_ns
    judged_grasps.judge(judging, ["train_000"])
    assert shard.stat().st_mtime_ns == before, "what is there is not judged again"
    with pytest.raises(JudgedGraspsError, match=r"asked for .*'samples': 4"):
        judged_grasps.judge(replace(judging, samples=4), ["train_000"])


def test_impossible_counts_are_an_error(judging: JudgeConfig) -> None:
    with pytest.raises(ValueError, match="samples is 0; expected at least 1"):
        replace(judging, samples=0)
