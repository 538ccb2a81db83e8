"""What SPLIT's ideas are worth: ``python -m split_drake.studies.ablate --data DIR --out DIR``.

Trains the models of `ablation_variants`, evaluates all variants on the same scenes of test mugs,
and writes ``ablations.json`` and ``ablations.md``.  One that was killed goes on where it was: each
model is a training run in ``models/``, each row an evaluation in ``evaluations/``.
"""

import json
import os
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
from rich.console import Console

from split_drake.bad_input import require_count, require_numbers
from split_drake.data.dataset import SceneDataset
from split_drake.evaluation.evaluate import MugEvalOptions
from split_drake.evaluation.evaluation import METRICS, evaluate
from split_drake.experiments.command import run_command
from split_drake.experiments.lock import locked
from split_drake.experiments.provenance import file_sha256
from split_drake.files import read_json_object
from split_drake.pose_task import MUG_TASKS
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.detector import SamplerConfig
from split_drake.station.layout import Layout
from split_drake.studies.ablation_detectors import make_detector
from split_drake.studies.ablation_report import Cost, Row, terminal_table, write_report
from split_drake.studies.ablation_variants import MODELS, VARIANTS, Model, Variant
from split_drake.training.train import TrainConfig, TrainingRun
from split_drake.training.training_folder import TrainingFolder


@dataclass(frozen=True)
class AblateConfig:
    """An ablation.

    Attributes:
        data: folder written by split_drake.data.generate, of training mugs.
        out: output folder; one that holds a part of this ablation is completed.
        steps: of each model's training, of `BatchConfig.scenes` scenes each.
        scenes: of test mugs to evaluate on.
        physics_scenes: in how many of them grasps are tried in physics.
        seed: of weights, batches and scenes.
        device: to train on; "auto" takes CUDA where there is one.
        workers: processes of an evaluation.
        report_only: train and evaluate nothing; report what there is.
    """

    data: Path
    out: Path
    steps: int = 3000
    scenes: int = 500
    physics_scenes: int = 0
    seed: int = 0
    device: Literal["auto", "cpu", "cuda"] = "auto"
    workers: int = len(os.sched_getaffinity(0))
    report_only: bool = False

    def __post_init__(self) -> None:
        require_numbers(self)
        for name, least in (("steps", 1), ("scenes", 1), ("physics_scenes", 0), ("workers", 1)):
            require_count(name, getattr(self, name), least)

    def training(self, model: Model) -> TrainConfig:
        """Return the training run of a model."""
        out = model.folder(self.out)
        return TrainConfig(
            data=self.data,
            out=out,
            steps=self.steps,
            device=self.device,
            seed=self.seed,
            resume=TrainingFolder(out).state.exists(),
            network=model.network,
            tasks=model.tasks,
        )

    def eval_options(self, variant: Variant) -> MugEvalOptions:
        """Return the scenes that a variant is evaluated on: the same for all but for the noise."""
        return MugEvalOptions(
            scenes=self.scenes,
            physics_scenes=self.physics_scenes,
            noise_m=variant.noise_m,
            seed=self.seed,
        )

    def evaluation(self, variant: Variant) -> Path:
        """Return the folder of a variant's evaluation."""
        return self.out / "evaluations" / variant.folder_name

    def weights(self, variant: Variant) -> tuple[Path, ...]:
        """Return a variant's checkpoints."""
        if not variant.models:
            return (default_weights(),)
        return tuple(TrainingFolder(model.folder(self.out)).weights for model in variant.models)


def is_trained(run: TrainConfig, dataset_hash: str) -> bool:
    """Return whether a run has come to its end; exit where its folder holds another one."""
    weights = TrainingFolder(run.out).weights
    if not weights.exists():
        return False
    _, info = load_checkpoint(weights)
    if (info.training, info.dataset_hash) != (run.record(), dataset_hash):
        raise SystemExit(
            f"{run.out} holds a run with other options or data: models of an ablation must be "
            "trained alike; choose another folder"
        )
    return info.steps == run.steps


def train_models(config: AblateConfig, console: Console) -> None:
    """Train the models that are missing."""
    dataset = SceneDataset.open(config.data)
    for model in MODELS:
        run = config.training(model)
        if not is_trained(run, dataset.dataset_hash):
            console.print(f"training {model.name}")
            with TrainingFolder(run.out).locked(run.resume):
                TrainingRun(run, dataset, console).execute()


def describe(config: AblateConfig, variant: Variant) -> dict[str, Any]:
    """Return what tells a variant's detector from others."""
    return {
        "checkpoints_sha256": [file_sha256(path) for path in config.weights(variant)],
        "ranked": variant.ranked,
        "sampler": asdict(SamplerConfig()),
    }


def evaluate_variant(config: AblateConfig, variant: Variant, console: Console) -> Row:
    """Return the row of a variant whose models are trained, evaluated unless it was before."""
    weights = config.weights(variant)
    _, info = load_checkpoint(weights[0])
    evaluation = config.eval_options(variant).evaluation(
        partial(make_detector, weights, variant.ranked),
        describe(config, variant),
        MUG_TASKS,
        Layout(workspace=info.workspace),
    )
    metrics = evaluate(evaluation, config.evaluation(variant), config.workers, console)
    return Row(variant, Cost.of(weights), metrics)


def rows_at_hand(config: AblateConfig, console: Console) -> list[Row]:
    """Return the rows of the variants that were evaluated; exit where that was of other weights."""
    rows = []
    for variant in VARIANTS:
        path = config.evaluation(variant) / METRICS
        if not path.exists():
            console.print(f"not evaluated yet: {path.parent}")
            continue
        metrics = read_json_object(path, "the metrics of an evaluation")
        asked = metrics.get("question", {})  # which older files don't have
        if asked.get("detector") != json.loads(json.dumps(describe(config, variant))):
            raise SystemExit(
                f"{path} is of other weights, another sampler or an older format than there are now"
            )
        rows.append(Row(variant, Cost.of(config.weights(variant)), metrics))
    return rows


def ablate(config: AblateConfig, console: Console) -> list[Row]:
    """Do what is missing of an ablation, and write its report after each row; return the rows."""
    if config.report_only:
        rows = rows_at_hand(config, console)
        write_report(rows, config.out)
        return rows
    train_models(config, console)
    rows = []
    for variant in VARIANTS:
        console.print(f"evaluating {variant.folder_name}")
        rows.append(evaluate_variant(config, variant, console))
        write_report(rows, config.out)
    return rows


def main(config: AblateConfig) -> None:
    """Ablate, and print the table."""
    torch.set_float32_matmul_precision("high")
    terminal = Console(soft_wrap=True)
    with locked(config.out):
        terminal.print(terminal_table(ablate(config, terminal)))


if __name__ == "__main__":
    run_command(main, AblateConfig)
