"""The ablation: its variants train, a killed one goes on, and its table says what it measured."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rich.console import Console

from split_drake.evaluation.examiner import DetectorMaker
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene, Workspace
from split_drake.split.detector import SamplerConfig, ScoredSamples, SplitDetector
from split_drake.split.network import TASKS, SplitConfig
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
from split_drake.training.losses import Losses
from tests.helpers.training import BATCH, NETWORK, OPTIMIZER, make_scenes, scenes_on_cpu

SCENE = Scene(np.zeros((0, 3)), np.zeros((0, 3)), Workspace())


def small(network: SplitConfig) -> SplitConfig:
    """Return a small network of the same kind."""
    kind = {"context": network.context, "score_frame": network.score_frame}
    return replace(NETWORK, resolution=32, **kind)


def test_every_model_of_a_row_is_trained_and_rows_do_not_share_a_folder() -> None:
    assert {model for variant in VARIANTS for model in variant.models} == set(MODELS)
    assert len({model.name for model in MODELS}) == len(MODELS)
    assert len({variant.folder_name for variant in VARIANTS}) == len(VARIANTS)


def test_models_of_one_task_see_as_many_poses_of_it_as_the_model_of_all() -> None:
    for task, model in zip(TASKS, ONE_PER_TASK, strict=True):
        assert model.batch.tasks == (task,)
        number = TASKS.index(task)
        assert model.batch.task_counts[number] == FULL.batch.task_counts[number]
    negatives = [model.batch.negatives for model in ONE_PER_TASK]
    assert negatives == [FULL.batch.negatives, 0, 0], "negatives are grasps"


@pytest.mark.parametrize(
    "model", [GLOBAL_LATENT, GLOBAL_LATENT_SAMPLE_FRAME, GLOBAL_FRAME], ids=lambda m: m.name
)
def test_variants_of_the_network_learn(model: Model) -> None:
    engine = trainer.Trainer(
        scenes_on_cpu(), small(model.network), BATCH, OPTIMIZER, seed=0, bfloat16=False
    )
    losses = [engine.take_step(progress=0.0).denoising.detach() for _ in range(60)]
    first, last = (torch.stack(part).mean(0) for part in (losses[:10], losses[-10:]))
    assert (last < 0.95 * first).all(), f"{first} -> {last}"


@dataclass
class FixedDetector:
    """Returns as many poses at height `z_m` as asked for, the highest ranked first."""

    z_m: float = 0.0
    config: SamplerConfig = SamplerConfig(samples=50)  # noqa: RUF009, frozen
    asked: tuple[PoseTask, ...] = ()

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, ScoredSamples]:
        self.asked = tuple(tasks)
        X_WPs = np.tile(np.eye(4), (self.config.samples, 1, 1))
        X_WPs[:, 2, 3] = self.z_m
        scores = np.linspace(1.0, 0.0, self.config.samples)
        return {task: ScoredSamples(X_WPs, scores) for task in tasks}


def test_without_an_evaluator_chance_ranks_all_samples() -> None:
    detector = ChanceRanking(FixedDetector())
    samples = detector.sample(SCENE, TASKS, np.random.default_rng(0))
    again = detector.sample(SCENE, TASKS, np.random.default_rng(0))
    tops = {int(samples[task].scores.argmax()) for task in TASKS}
    assert tops != {0}, "the evaluator would rank the first sample highest"
    for task in TASKS:
        assert np.array_equal(samples[task].scores, again[task].scores)
        assert (samples[task].scores >= detector.config.threshold).all()
        assert len(np.unique(samples[task].scores)) == 50


def test_each_task_is_asked_of_its_own_model() -> None:
    detectors = {task: FixedDetector(z_m=0.1 * i) for i, task in enumerate(TASKS)}
    together = ModelPerTask(detectors)
    samples = together.sample(SCENE, TASKS, np.random.default_rng(0))
    for i, task in enumerate(TASKS):
        assert detectors[task].asked == (task,)
        assert samples[task].X_WPs[0, 2, 3] == pytest.approx(0.1 * i)
    with pytest.raises(ValueError, match="2 configurations; expected one"):
        ModelPerTask(detectors | {TASKS[0]: FixedDetector(config=SamplerConfig(samples=2))})


# --- whole ablations, of small models on posts, whose evaluation is a stand-in ---

BUDGET = 6


def small_models() -> tuple[Model, ...]:
    """Return a full model, one with a global latent, and one for handles alone."""
    handles = replace(BATCH, grasps=0, uprights=0, negatives=0)
    return (
        Model("full", NETWORK, BATCH),
        Model("global_latent", small(GLOBAL_LATENT.network), BATCH),
        Model("only_handle", NETWORK, handles),
    )


def stand_in_metrics(
    make: DetectorMaker, detector: dict[str, Any], options: Any, out: Path, *_: object
) -> dict[str, Any]:
    """Write and return metrics as `evaluation.evaluate` does, without looking at any scene."""
    assert isinstance(make, partial)
    assert isinstance(make(), SplitDetector | ModelPerTask | ChanceRanking)
    hits = options.scenes // 2
    share = {"share": 0.5, "hits": hits, "scenes": options.scenes, "wilson95": [0.41, 0.59]}
    figures = {"top_good": {"all": share}, "samples_good": {"all": {"share": 0.25}}}
    metrics = {str(task): figures for task in TASKS} | {"detector": detector, "by_mug": {}}
    out.mkdir(parents=True, exist_ok=True)
    (out / "metrics.json").write_text(json.dumps(metrics))
    return metrics


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AblateConfig:
    """Return a short ablation of small models."""
    full, latent, handle = small_models()
    variants = (
        Variant("full", "SPLIT", (full,)),
        Variant("global latent", "no local kernel", (latent,)),
        Variant("without evaluator", "ranked by chance", (full,), ranked=False),
        Variant("three models", "one each", (full, handle, full)),
        Variant("full", "SPLIT", (full,), noise_m=0.01),
    )
    monkeypatch.setattr(ablate, "MODELS", (full, latent, handle))
    monkeypatch.setattr(ablate, "VARIANTS", variants)
    monkeypatch.setattr(ablate, "evaluate", stand_in_metrics)
    monkeypatch.setattr(ablate.MugDataset, "open", staticmethod(lambda folder: make_scenes()))
    return AblateConfig(
        data=tmp_path / "posts", out=tmp_path / "ablation", steps=BUDGET, scenes=100, device="cpu"
    )


def run(config: AblateConfig) -> list[dict[str, Any]]:
    """Run an ablation; return the rows of its report."""
    ablate.ablate(config, Console(quiet=True))
    rows: list[dict[str, Any]] = json.loads((config.out / "ablations.json").read_text())["rows"]
    return rows


def test_rows_say_what_they_cost_and_how_they_fare(config: AblateConfig) -> None:
    rows = {(row["name"], row["noise_m"]): row for row in run(config)}
    assert len(rows) == 5
    one, three = rows["full", 0.005], rows["three models", 0.005]
    assert one["scene_steps"] == BUDGET * BATCH.scenes
    assert (three["models"], three["scene_steps"]) == (3, 3 * one["scene_steps"])
    assert three["parameters"] == 3 * one["parameters"]
    assert rows["without evaluator", 0.005]["parameters"] == one["parameters"]
    assert one["metrics"]["handle"]["top_good"]["all"]["hits"] == 50
    table = (config.out / "ablations.md").read_text().splitlines()
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
    assert len(taken) == 2 * BUDGET, "the first model was trained, the second was not saved yet"
    assert run(config) == rows
    assert len(taken) == 2 * BUDGET


def test_only_the_report_can_be_made_again(
    config: AblateConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = run(config)
    (config.out / "ablations.json").unlink()
    monkeypatch.setattr(ablate, "evaluate", None)
    monkeypatch.setattr(ablate, "Run", None)
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


def test_models_that_were_trained_otherwise_are_not_compared(config: AblateConfig) -> None:
    run(config)
    for changed in (replace(config, steps=BUDGET + 1), replace(config, seed=1)):
        with pytest.raises(SystemExit, match="must be trained alike"):
            run(changed)


@pytest.mark.parametrize("count", [0, 2])
def test_a_detector_has_one_checkpoint_or_one_for_each_task(count: int, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"{count} checkpoints; expected 1 or 3"):
        make_detector((tmp_path,) * count, ranked=True)
