"""The ablation: its variants train, a killed one goes on, and its table says what it measured."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rich.console import Console

from split_drake.evaluation.evaluation import Evaluation
from split_drake.pose_set import Acceptance, PoseSet, SamplingDetector, ScoredPoses, accepted_poses
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask, UnknownTaskError, find_tasks
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import default_weights
from split_drake.split.detector import SplitDetector
from split_drake.split.network_config import SplitConfig
from split_drake.studies import ablate
from split_drake.studies.ablate import AblateConfig
from split_drake.studies.ablation_detectors import ChanceRanking, ModelPerTask, make_detector
from split_drake.studies.ablation_variants import (
    FULL,
    GLOBAL_FRAME,
    GLOBAL_LATENT,
    GLOBAL_LATENT_SAMPLE_FRAME,
    MODELS,
    ONE_PER_TASK,
    VARIANTS,
    Model,
    Variant,
)
from split_drake.training import trainer
from split_drake.training.batches import BatchConfig, draw_batch
from split_drake.training.losses import Losses, compute_losses
from tests.helpers.training import BATCH, NETWORK, OPTIMIZER, make_scenes, scenes_on_cpu

SAMPLES = 50
POINT = np.array([[0.5, 0.0, 0.1]])
SCENE = Scene(POINT, POINT, Workspace())


def small(network: SplitConfig) -> SplitConfig:
    """Return a small network of the same kind."""
    return replace(NETWORK, resolution=32, context=network.context, score_frame=network.score_frame)


def test_every_model_of_a_row_is_trained_and_rows_do_not_share_a_folder() -> None:
    assert {model for variant in VARIANTS for model in variant.models} == set(MODELS)
    assert len({model.name for model in MODELS}) == len(MODELS)
    assert len({variant.folder_name for variant in VARIANTS}) == len(VARIANTS)


def test_models_of_one_task_see_as_many_poses_of_it_as_the_model_of_all(tmp_path: Path) -> None:
    config = AblateConfig(data=tmp_path, out=tmp_path / "out")
    full = config.training(FULL)
    assert full.tasks == tuple(task.name for task in MUG_TASKS)
    for task, model in zip(MUG_TASKS, ONE_PER_TASK, strict=True):
        run = config.training(model)
        assert run.tasks == (task.name,)
        assert run.batch.trained((task,)) == (task,)
        assert run.batch.count(task) == full.batch.count(task)
        assert run.batch.negatives == full.batch.negatives


@pytest.mark.parametrize(
    "model", [GLOBAL_LATENT, GLOBAL_LATENT_SAMPLE_FRAME, GLOBAL_FRAME], ids=lambda m: m.name
)
def test_variants_of_the_network_learn(model: Model) -> None:
    scenes, network = scenes_on_cpu(), small(model.network)
    engine = trainer.Trainer(scenes, network, BATCH, OPTIMIZER, seed=0, bfloat16=False)
    # The losses of one large batch: those of the steps are of a few poses each.
    generator = torch.Generator().manual_seed(0)
    batch = draw_batch(scenes, replace(BATCH, scenes=64), network, generator)
    with torch.no_grad():
        first = compute_losses(engine.network, batch, bfloat16=False).denoising
    for _ in range(120):
        engine.take_step(progress=0.0)
    with torch.no_grad():
        last = compute_losses(engine.network, batch, bfloat16=False).denoising
    assert (last < 0.95 * first).all(), f"{first} -> {last}"


@dataclass
class FixedDetector:
    """Returns `SAMPLES` poses at height `z_m`, the highest ranked first."""

    z_m: float = 0.0
    acceptance: Acceptance = field(default_factory=lambda: Acceptance(0.4, 0.4))
    asked: tuple[str, ...] = ()

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, ScoredPoses]:
        self.asked = tuple(map(str, tasks))
        X_WPs = np.tile(np.eye(4), (SAMPLES, 1, 1))
        X_WPs[:, 2, 3] = self.z_m
        return {name: ScoredPoses(X_WPs, np.linspace(1.0, 0.0, SAMPLES)) for name in self.asked}

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        known = find_tasks(tasks, MUG_TASKS, "the detector")
        return accepted_poses(self.sample(scene, known, rng), known, self.acceptance)


def test_without_an_evaluator_chance_ranks_all_samples() -> None:
    detector = ChanceRanking(FixedDetector(), MUG_TASKS)
    samples = detector.sample(SCENE, MUG_TASKS, np.random.default_rng(0))
    again = detector.sample(SCENE, MUG_TASKS, np.random.default_rng(0))
    assert samples.keys() == {"grasp", "handle", "upright"}
    tops = {int(drawn.scores.argmax()) for drawn in samples.values()}
    assert tops != {0}, "the evaluator would rank the first sample highest"
    for name, drawn in samples.items():
        assert np.array_equal(drawn.scores, again[name].scores)
        assert detector.acceptance.accepted(drawn.scores).all()
        assert len(np.unique(drawn.scores)) == SAMPLES
    found = detector.detect(SCENE, ("handle",), np.random.default_rng(0))
    assert {name: len(pose_set) for name, pose_set in found.items()} == {"handle": SAMPLES}


def test_each_task_is_asked_of_its_own_model() -> None:
    detectors = {task: FixedDetector(z_m=0.1 * i) for i, task in enumerate(MUG_TASKS)}
    together = ModelPerTask(detectors)
    samples = together.sample(SCENE, MUG_TASKS, np.random.default_rng(0))
    for i, task in enumerate(MUG_TASKS):
        assert detectors[task].asked == (task.name,)
        assert samples[task.name].X_WPs[0, 2, 3] == pytest.approx(0.1 * i)
    found = together.detect(SCENE, ("upright",), np.random.default_rng(0))["upright"]
    assert found.task == MUG_TASKS[2]
    assert 0 < len(found) < SAMPLES, "some are rejected"
    with pytest.raises(ValueError, match="accept scores in 2 ways; expected one"):
        ModelPerTask(detectors | {MUG_TASKS[0]: FixedDetector(acceptance=Acceptance(0.2, 0.2))})


@pytest.mark.parametrize(
    "detector",
    [ChanceRanking(FixedDetector(), (GRASP,)), ModelPerTask({GRASP: FixedDetector()})],
    ids=lambda detector: type(detector).__name__,
)
def test_tasks_that_no_model_knows_are_an_error(detector: SamplingDetector) -> None:
    with pytest.raises(UnknownTaskError, match="the detector has no task 'handle'; it has grasp"):
        detector.detect(SCENE, MUG_TASKS, np.random.default_rng(0))


# --- whole ablations, of small models on posts, whose evaluation is a stand-in ---

BUDGET = 6


def small_models() -> tuple[Model, ...]:
    """Return a full model, one with a global latent, and one each for a task alone."""
    return (
        Model("full", NETWORK),
        Model("global_latent", small(GLOBAL_LATENT.network)),
        *(replace(model, network=NETWORK) for model in ONE_PER_TASK),
    )


def stand_in_metrics(evaluation: Evaluation, out: Path, *_: object) -> dict[str, Any]:
    """Write and return metrics as `evaluation.evaluate` does, without looking at any scene."""
    assert evaluation.tasks == MUG_TASKS
    assert isinstance(evaluation.make_detector, partial)
    detector = evaluation.make_detector()
    assert isinstance(detector, SplitDetector | ModelPerTask | ChanceRanking)
    assert detector.tasks == MUG_TASKS
    scenes = evaluation.scenes
    share = {"share": 0.5, "hits": scenes // 2, "scenes": scenes, "wilson95": [0.41, 0.59]}
    figures = {"top_good": {"all": share}, "samples_good": {"all": {"share": 0.25}}}
    metrics = {
        "tasks": {task.name: figures for task in MUG_TASKS},
        "question": {"detector": evaluation.detector},
        "by_subject": {},
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "metrics.json").write_text(json.dumps(metrics))
    return metrics


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AblateConfig:
    """Return a short ablation of small models."""
    full, latent, *one_per_task = small_models()
    variants = (
        Variant("full", "SPLIT", (full,)),
        Variant("global latent", "no local kernel", (latent,)),
        Variant("without evaluator", "ranked by chance", (full,), ranked=False),
        Variant("three models", "one each", tuple(one_per_task)),
        Variant("full", "SPLIT", (full,), noise_m=0.01),
    )
    monkeypatch.setattr(ablate, "MODELS", (full, latent, *one_per_task))
    monkeypatch.setattr(ablate, "VARIANTS", variants)
    monkeypatch.setattr(ablate, "evaluate", stand_in_metrics)
    monkeypatch.setattr(ablate.SceneDataset, "open", lambda folder: make_scenes())
    return AblateConfig(
        data=tmp_path / "posts", out=tmp_path / "ablation", steps=BUDGET, scenes=100, device="cpu"
    )


def run(config: AblateConfig) -> list[dict[str, Any]]:
    """Run an ablation; return the rows of its report."""
    ablate.ablate(config, Console(quiet=True))
    rows: list[dict[str, Any]] = json.loads((config.out / "ablations.json").read_text())["rows"]
    return rows


def test_rows_say_what_they_cost_and_what_they_reach(config: AblateConfig) -> None:
    rows = {(row["name"], row["noise_m"]): row for row in run(config)}
    assert len(rows) == 5
    one, three = rows["full", 0.005], rows["three models", 0.005]
    assert one["scene_steps"] == BUDGET * BatchConfig().scenes
    assert (three["models"], three["scene_steps"]) == (3, 3 * one["scene_steps"])
    # Both heads of a model for one task are told of two tasks less.
    spared = 2 * 2 * NETWORK.condition_width
    assert three["parameters"] == 3 * (one["parameters"] - spared)
    assert rows["without evaluator", 0.005]["parameters"] == one["parameters"]
    assert one["metrics"]["tasks"]["handle"]["top_good"]["all"]["hits"] == 50
    table = (config.out / "ablations.md").read_text().splitlines()
    page = (config.out / "index.html").read_text()
    assert page.count('<tr id="setting-') == len(table) - 2
    assert len(table) == 2 + 5
    assert "| 50.0% [41.0, 59.0] |" in table[2]
    assert "25 / 25 / 25" in table[2]
    assert "grasp holds" not in table[0], "nothing was tried in physics"


def kill_at(step: int, patch: pytest.MonkeyPatch) -> list[int]:
    """Have the training stop at its `step`th step in all; return a list of the steps taken."""
    take_step, taken = trainer.Trainer.take_step, list[int]()

    def counted(engine: trainer.Trainer, progress: float) -> Losses:
        if len(taken) == step:
            raise KeyboardInterrupt
        taken.append(engine.step)
        return take_step(engine, progress)

    patch.setattr(trainer.Trainer, "take_step", counted)
    return taken


def test_a_killed_ablation_goes_on(config: AblateConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        kill_at(BUDGET + 2, patch)
        run(config)
    taken = kill_at(100, monkeypatch)
    rows = run(config)
    assert len(taken) == 4 * BUDGET, "the first model was trained, the second was not saved yet"
    assert run(config) == rows
    assert len(taken) == 4 * BUDGET


def test_only_the_report_can_be_made_again(
    config: AblateConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = run(config)
    (config.out / "ablations.json").unlink()
    monkeypatch.setattr(ablate, "evaluate", None)
    monkeypatch.setattr(ablate, "TrainingRun", None)
    report_only = replace(config, report_only=True)
    assert run(report_only) == rows
    (config.out / "evaluations" / "three_models_5mm" / "metrics.json").unlink()
    assert [row["name"] for row in run(report_only)] == [
        row["name"] for row in rows if row["name"] != "three models"
    ]
    weights = config.out / "models" / "full" / "split.safetensors"
    weights.write_bytes((config.out / "models/global_latent/split.safetensors").read_bytes())
    with pytest.raises(SystemExit, match="of other weights"):
        run(report_only)
    (config.out / "evaluations" / "full_5mm" / "metrics.json").write_text('{"detector": {}}')
    with pytest.raises(SystemExit, match=r"full_5mm/metrics.json is of .* an older format"):
        run(report_only)


def test_models_that_were_trained_otherwise_are_not_compared(config: AblateConfig) -> None:
    run(config)
    for changed in (replace(config, steps=BUDGET + 1), replace(config, seed=1)):
        with pytest.raises(SystemExit, match="must be trained alike"):
            run(changed)


def test_a_detector_has_one_checkpoint_or_one_for_each_task() -> None:
    with pytest.raises(ValueError, match=r"2 checkpoints know grasp, .*; expected one task each"):
        make_detector((default_weights(),) * 2, ranked=True)
    with pytest.raises(ValueError, match="no checkpoints; expected at least one"):
        make_detector((), ranked=True)
