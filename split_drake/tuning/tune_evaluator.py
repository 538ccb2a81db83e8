"""Tune a checkpoint's evaluator on grasps that the model drew itself, and that were judged.

    python -m split_drake.tuning.tune_evaluator judge --checkpoint F --out DIR
    python -m split_drake.tuning.tune_evaluator judge-clutter --checkpoint F --library L --out DIR
    python -m split_drake.tuning.tune_evaluator tune --judged DIR --data DIR --init F --out FILE

Training shows the evaluator true poses that noise has moved, and calls them bad by how far.  What
it has to tell apart when the model is used are poses that all look about right.  Which of these
grasps hold is found out by trying them: in physics on mugs, by geometry in clutter.  So the
evaluator alone is trained here: on judged grasps, and as before on poses of other tasks and false
grasps.  Encoder and score stay as they were: the tuned model draws the same samples, and ranks them
otherwise.  With `--whole` the encoder learns from judged grasps as well, and the score goes on
learning as in training.
"""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from rich.console import Console

from split_drake.data.dataset import SceneDataset
from split_drake.experiments.command import run_commands
from split_drake.experiments.provenance import git_commit
from split_drake.objects.mugs.split import mug_names
from split_drake.pose_task import UnknownTaskError
from split_drake.scene import Workspace
from split_drake.split.checkpoint import CheckpointInfo, load_checkpoint, save_checkpoint
from split_drake.station.layout import Layout
from split_drake.training.train import parent_record
from split_drake.training.training_scenes import TrainingScenes
from split_drake.tuning.evaluator_tuning import (
    JudgedScenes,
    TuneConfig,
    ranking_quality,
    tune_steps,
)
from split_drake.tuning.judged_clutter import JudgeClutterConfig, judge_clutter
from split_drake.tuning.judged_grasps import JudgedGrasps
from split_drake.tuning.judged_mugs import JudgeConfig, judge

LOG_STEPS = 100


def tune(config: TuneConfig) -> None:
    """Tune, print what it brought on shards that were held out, and write the checkpoint."""
    console = Console(soft_wrap=True)
    network, info = load_checkpoint(config.init)
    dataset = SceneDataset.open(config.data)
    try:
        scenes = TrainingScenes.of(dataset, network.tasks, torch.device("cpu"))
    except UnknownTaskError as error:
        raise SystemExit(f"{config.data}: {error}") from error
    judged = JudgedGrasps.open(config.judged)
    _require_one_workspace(config, info.workspace, dataset.workspace, judged.workspace)
    used, held_out = JudgedScenes.split(judged)
    before = ranking_quality(network, held_out)
    losses: list[float] = []
    for loss in tune_steps(network, scenes, used, config):
        losses.append(loss)
        if len(losses) % LOG_STEPS == 0:
            console.print(f"step {len(losses)}  loss {np.mean(losses[-LOG_STEPS:]):.5f}")
    after = ranking_quality(network.eval(), held_out)
    for name in before:
        console.print(f"{name}, held out: {before[name]:.3f} before, {after[name]:.3f} after")
    metrics = {"tuning": {"before": before, "after": after}}
    save_checkpoint(config.out, network, _tuned_info(config, info, dataset.dataset_hash, metrics))


def _require_one_workspace(config: TuneConfig, *workspaces: Workspace) -> None:
    """Exit unless checkpoint, dataset and judged grasps are of one workspace."""
    paths = (config.init, config.data, config.judged)
    if len(set(workspaces)) > 1:
        each = "; ".join(f"{path}: {own}" for path, own in zip(paths, workspaces, strict=True))
        raise SystemExit(f"expected files of one workspace: {each}")


def _tuned_info(
    config: TuneConfig, info: CheckpointInfo, dataset_hash: str, metrics: dict[str, Any]
) -> CheckpointInfo:
    """Return where the tuned network comes from."""
    options = {"batch": asdict(config.batch), "learning_rate": config.learning_rate}
    return replace(
        info,
        training=options,
        seed=config.seed,
        dataset_hash=dataset_hash,
        commit=git_commit(),
        steps=config.steps,
        scenes=2 * config.steps * config.batch.scenes,
        metrics=metrics,
        earlier_commits=(),
        parent=parent_record(config.init, info),
    )


def main(config: JudgeConfig | JudgeClutterConfig | TuneConfig) -> None:
    """Run one of the commands."""
    if isinstance(config, TuneConfig):
        tune(config)
        return
    _, info = load_checkpoint(config.checkpoint)
    layout = Layout(workspace=info.workspace)
    if isinstance(config, JudgeConfig):
        judge(config, mug_names("train"), layout)
    else:
        judge_clutter(config, layout)


if __name__ == "__main__":
    run_commands(
        main, {"judge": JudgeConfig, "judge-clutter": JudgeClutterConfig, "tune": TuneConfig}
    )
