"""Grasps that a model draws are tried in physics, and teach its evaluator alone."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from split_drake.data.object_scenes import ObjectScene
from split_drake.evaluation.scenes import EvalMugs
from split_drake.experiments.run import AnotherRunError, claim_folder
from split_drake.grasps.free_hand import GraspOutcome
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import ScoredPoses
from split_drake.pose_task import GRASP, MUG_TASKS, UPRIGHT, PoseTask
from split_drake.poses import Array, make_pose, rotation_x
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import load_checkpoint
from split_drake.split.detector import SplitDetector
from split_drake.split.sampling import StepCallback
from split_drake.station.layout import Layout
from split_drake.tuning import judged_mugs, tune_evaluator
from split_drake.tuning.evaluator_tuning import (
    JudgedScenes,
    TuneConfig,
    ranking_quality,
    tune_steps,
)
from split_drake.tuning.judged_grasps import JudgedGrasps, JudgedGraspsError
from split_drake.tuning.judged_mugs import JudgeConfig
from tests.helpers.checkpoints import new_network, save_new_network
from tests.helpers.evaluation import standing
from tests.helpers.training import BATCH, FIRM_M, make_scenes, scenes_on_cpu


def judged_posts() -> JudgedGrasps:
    """Return grasps of posts: every other one at the top, and the rest, which do not hold, beside.

    There are 20 scenes in 10 shards.
    """
    scenes = make_scenes(20)
    sideways_m = np.array([0.0, 0.05] * 4)
    zeros = np.zeros(8)
    X_OGs = make_pose(p=np.column_stack([zeros, sideways_m, zeros + FIRM_M]))
    return JudgedGrasps(
        clouds=scenes.clouds,
        sampled=(scenes.X_WOs[:, None] @ X_OGs).astype(np.float32),
        held=np.tile(sideways_m == 0.0, (20, 1)),
        shard_index=np.arange(20) // 2,
        shards=10,
        workspace=scenes.workspace,
    )


@pytest.fixture
def config(tmp_path: Path) -> TuneConfig:
    return TuneConfig(
        judged=tmp_path / "judged",
        data=tmp_path / "posts",
        init=tmp_path / "init.safetensors",
        out=tmp_path / "tuned.safetensors",
        steps=60,
        learning_rate=3e-3,
        batch=replace(BATCH, poses_of=(("grasp", 0),)),
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


def test_the_whole_network_learns_from_judged_grasps(config: TuneConfig) -> None:
    network = new_network()
    before = {name: value.clone() for name, value in network.state_dict().items()}
    used, held_out = JudgedScenes.split(judged_posts())
    whole = replace(config, whole=True, batch=BATCH)
    losses = list(tune_steps(network, scenes_on_cpu(), used, whole))
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:10])
    assert ranking_quality(network, held_out)["auc"] > 0.9
    kept = {
        name for name, value in network.state_dict().items() if torch.equal(value, before[name])
    }
    statistics = {name for name, _ in network.named_buffers()} & before.keys()
    assert kept == statistics, "all that is learnt has learnt, and nothing else has changed"


def test_grasps_may_be_any_of_the_tasks_of_a_network(config: TuneConfig) -> None:
    tasks = (UPRIGHT, GRASP)
    used, held_out = JudgedScenes.split(judged_posts())
    network = new_network(tasks)
    list(tune_steps(network, scenes_on_cpu(tasks), used, config))
    assert ranking_quality(network, held_out)["auc"] > 0.9


def test_the_tuned_checkpoint_says_where_it_comes_from(
    config: TuneConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tune_evaluator.SceneDataset, "open", lambda folder: make_scenes())
    monkeypatch.setattr(JudgedGrasps, "open", lambda folder: judged_posts())
    save_new_network(config.init)
    tune_evaluator.tune(replace(config, steps=2))
    _, tuned = load_checkpoint(config.out)
    assert (tuned.steps, tuned.scenes, tuned.dataset_hash) == (2, 16, "post")
    assert tuned.parent is not None
    assert (tuned.parent["commit"], tuned.parent["steps"]) == ("abc", 7)
    assert tuned.metrics["tuning"]["before"]["holds"] == 0.5
    assert (tuned.tasks, tuned.workspace) == (MUG_TASKS, Workspace())


def test_too_few_mugs_and_unjudged_grasps_are_errors(config: TuneConfig) -> None:
    posts = judged_posts()
    few = replace(posts, shard_index=posts.shard_index % 9, shards=9)
    with pytest.raises(ValueError, match="9 shards; expected at least 10"):
        JudgedScenes.split(few)
    with pytest.raises(ValueError, match=r"batch\.poses_of has 8 grasps; expected 0"):
        replace(config, batch=BATCH)
    with pytest.raises(ValueError, match=r"batch\.poses_of has 0 grasps; expected some"):
        replace(config, whole=True)


class DetectorOfTwo(SplitDetector):
    """Detects a grasp above the mug's middle, and one below the table."""

    def __init__(self) -> None:
        super().__init__(new_network(), Workspace())

    def sample(
        self,
        scene: Scene,
        tasks: Sequence[PoseTask | str],
        rng: np.random.Generator,
        callback: StepCallback | None = None,
    ) -> dict[str, ScoredPoses]:
        middle = scene.p_WSs.mean(axis=0)
        p_WGs = np.stack([[middle[0], middle[1], 0.3], [middle[0], middle[1], -0.1]])
        X_WGs = make_pose(np.stack([rotation_x(np.pi)] * 2), p_WGs)
        return {"grasp": ScoredPoses(X_WGs, np.array([0.5, 0.5]))}


class HandThatHoldsAll:
    """Stands in for physics; remembers what it was asked to try."""

    def __init__(self) -> None:
        self.heights_m: list[float] = []

    def try_in_scene(self, X_WO: Array, X_WG: Array, opening_m: float) -> GraspOutcome:
        self.heights_m.append(X_WG[2, 3])
        return GraspOutcome("", 0.0, 0.0)


def test_grasps_are_tried_where_the_hand_can_go(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud, hand = make_scenes().clouds[0].astype(float), HandThatHoldsAll()
    scene = ObjectScene(
        make_pose(p=(0.5, 0.0, 0.0)), cloud, cloud, 0, 2, np.array([0.5, 0.0, 0.6]), 0.0
    )
    mug = standing(load_mug("train_003"))
    monkeypatch.setitem(mug.__dict__, "hand", hand)
    monkeypatch.setattr(mug, "draw", lambda rng: scene)
    rng = np.random.default_rng(0)
    drawn = judged_mugs.judge_scene(mug, DetectorOfTwo(), Workspace(), rng)
    assert drawn["held"].tolist() == [True, False]
    assert hand.heights_m == [0.3], "the hand cannot go below the table"
    assert drawn["clouds"].dtype == drawn["sampled"].dtype == np.float32
    assert np.allclose(drawn["clouds"], cloud), "what is kept has no noise"


@pytest.fixture
def judging(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> JudgeConfig:
    """Return a configuration whose scenes are posts, drawn by nothing."""
    posts = judged_posts()
    scene = {"clouds": posts.clouds[0], "sampled": posts.sampled[0], "held": posts.held[0]}
    monkeypatch.setattr(judged_mugs, "judge_scene", lambda *_: scene)
    monkeypatch.setattr(EvalMugs, "make", lambda *_: None)
    checkpoint = tmp_path / "split.safetensors"
    save_new_network(checkpoint)
    (tmp_path / "judged").mkdir()
    return JudgeConfig(checkpoint=checkpoint, out=tmp_path / "judged", scenes_per_mug=3, workers=1)


def judge_in_this_process(judging: JudgeConfig, names: list[str]) -> None:
    """Judge here, where what is patched holds."""
    record = judging.record() | {"workspace": asdict(Layout().workspace), "shards": names}
    with claim_folder(judging.out, record):
        for name in names:
            judged_mugs.write_judged(judging, Layout(), name)


def test_judged_grasps_are_kept_by_mug(judging: JudgeConfig) -> None:
    names = ["train_000", "train_001"]
    judge_in_this_process(judging, names)
    judged_mugs.judge(judging, names, Layout())
    read = JudgedGrasps.open(judging.out)
    assert read.clouds.shape == (6, 2000, 3)
    assert read.sampled.shape == (6, 8, 4, 4)
    assert read.held.tolist() == [judged_posts().held[0].tolist()] * 6
    assert read.workspace == Workspace()
    assert (read.shard_index.tolist(), read.shards) == ([0, 0, 0, 1, 1, 1], 2)
    (judging.out / "train_001.npz").unlink()
    with pytest.raises(JudgedGraspsError, match=r"1 of 2 shards are missing, .*train_001\.npz"):
        JudgedGrasps.open(judging.out)
    with pytest.raises(JudgedGraspsError, match="does not say of which workspace"):
        JudgedGrasps.open(judging.out.parent)


def test_judging_goes_on_only_where_it_was_the_same(judging: JudgeConfig) -> None:
    judge_in_this_process(judging, ["train_000"])
    shard = judging.out / "train_000.npz"
    before = shard.stat().st_mtime_ns
    judged_mugs.judge(judging, ["train_000"], Layout())
    assert shard.stat().st_mtime_ns == before, "what is there is not judged again"
    with pytest.raises(AnotherRunError, match=r"another run \(samples was 16, is 4\)"):
        judged_mugs.judge(replace(judging, samples=4), ["train_000"], Layout())
    elsewhere = Layout(workspace=Workspace(p_WCenter=(0.4, 0.0, 0.0)))
    with pytest.raises(AnotherRunError, match=r"another run \(workspace was"):
        judged_mugs.judge(judging, ["train_000"], elsewhere)


def test_impossible_counts_are_an_error(judging: JudgeConfig) -> None:
    with pytest.raises(ValueError, match="samples is 0; expected at least 1"):
        replace(judging, samples=0)


def test_files_of_two_workspaces_are_refused(
    config: TuneConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = replace(judged_posts(), workspace=Workspace((0.6, 0.0, 0.0)))
    monkeypatch.setattr(tune_evaluator.SceneDataset, "open", lambda folder: make_scenes())
    monkeypatch.setattr(JudgedGrasps, "open", lambda folder: moved)
    save_new_network(config.init)
    with pytest.raises(
        SystemExit, match=r"expected files of one workspace: .*\(0\.6, 0\.0, 0\.0\)"
    ):
        tune_evaluator.tune(replace(config, steps=2))
