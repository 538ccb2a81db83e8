"""Measure a checkpoint: ``python -m split_drake.training.evaluate --data datasets/mugs_test``.

`judgement` says which poses count as good.
"""

import json
import time
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from split_drake.data.dataset import MugDataset
from split_drake.data.grasp_judge import GraspJudge
from split_drake.data.mugs import load_mug
from split_drake.pose_set import PoseTask
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import (
    CheckpointInfo,
    default_weights,
    load_checkpoint,
    save_checkpoint,
)
from split_drake.split.detector import SplitDetector
from split_drake.split.network import TASKS
from split_drake.training.judgement import (
    Judgement,
    TaskOutcome,
    judge_grasps,
    judge_poses,
    outcome,
    summarize,
)

VISIBLE_HANDLE_POINTS = 30


@dataclass(frozen=True)
class EvaluateConfig:
    """An evaluation.

    Attributes:
        data: folder written by split_drake.data.generate.
        checkpoint: weights; those of the project by default.
        scenes: how many of the data set's, spread evenly over it.
        noise_m: standard deviation of the noise on the points.
        seed: of noise and sampling.
        out: JSON file to write the metrics to; none by default.
        ship: where to write a copy of the checkpoint that records the metrics; none by default.  It
            must come from a known commit.
        allow_dirty: ship it also where the source differed from that commit.
        allow_training_data: evaluate also on the data that the checkpoint was trained on.
    """

    data: Path
    checkpoint: Path | None = None
    scenes: int = 200
    noise_m: float = 0.005
    seed: int = 0
    out: Path | None = None
    ship: Path | None = None
    allow_dirty: bool = False
    allow_training_data: bool = False


@cache
def _grasp_judge(mug_name: str) -> GraspJudge:
    return GraspJudge(load_mug(mug_name).body.mesh)


def _judge(task: PoseTask, X_WPs: Array, dataset: MugDataset, index: int) -> Judgement:
    """Compare a task's poses with the truth of the data set's scene `index`."""
    if task == PoseTask.GRASP:
        name = dataset.mug_names[dataset.mug_index[index]]
        return judge_grasps(X_WPs, _grasp_judge(name), dataset.X_WOs[index].astype(float))
    truths = dataset.handles if task == PoseTask.HANDLE else dataset.uprights
    return judge_poses(X_WPs, truths[index].astype(float))


def evaluate(
    detector: SplitDetector, dataset: MugDataset, config: EvaluateConfig, console: Console
) -> dict[str, Any]:
    """Return {task: summary, ...} over scenes spread evenly over `dataset`.

    Raises ValueError where it has fewer scenes than asked for.
    """
    if not 1 <= config.scenes <= len(dataset):
        raise ValueError(f"scenes is {config.scenes}; expected 1 to the data's {len(dataset)}")
    outcomes: dict[PoseTask, list[TaskOutcome]] = {task: [] for task in TASKS}
    durations_s = []
    chosen = np.linspace(0, len(dataset) - 1, config.scenes).round().astype(int).tolist()
    for index in track(chosen, "evaluating", console=console, disable=not console.is_terminal):
        rng = np.random.default_rng([config.seed, index])
        cloud = dataset.clouds[index].astype(float)
        scene = Scene(cloud, cloud, Workspace()).with_noise(config.noise_m, rng)
        start = time.perf_counter()
        samples = detector.sample(scene, TASKS, rng)
        durations_s.append(time.perf_counter() - start)
        visible = bool(dataset.handle_points[index] >= VISIBLE_HANDLE_POINTS)
        for task, drawn in samples.items():
            judgement = _judge(task, drawn.X_WPs, dataset, index)
            outcomes[task].append(
                outcome(drawn.scores, judgement, detector.config.threshold, visible)
            )
    return {
        **{str(task): summarize(outcomes[task]) for task in TASKS},
        "scenes": len(chosen),
        "scenes_handle_visible": sum(o.handle_visible for o in outcomes[PoseTask.HANDLE]),
        "seed": config.seed,
        "noise_m": config.noise_m,
        "sampler": asdict(detector.config),
        "median_detect_s": float(np.median(durations_s)),
        "dataset_hash": dataset.dataset_hash,
    }


def metrics_table(metrics: dict[str, Any]) -> Table:
    """Return the metrics, a column a task."""
    table = Table("", *(str(task) for task in TASKS), title=f"{metrics['scenes']} scenes")
    for name in metrics[str(TASKS[0])]:
        values = [metrics[str(task)][name] for task in TASKS]
        table.add_row(name, *("-" if value is None else f"{value:.3f}" for value in values))
    return table


def require_shippable(info: CheckpointInfo, allow_dirty: bool) -> None:
    """Exit where nobody could tell what source trained a checkpoint."""
    for commit in (*info.earlier_commits, info.commit):
        if commit == "unknown":
            raise SystemExit("the checkpoint's commit is unknown: train it from a git checkout")
        if commit.endswith("-dirty") and not allow_dirty:
            raise SystemExit(
                f"the checkpoint was trained by a source that differed from its commit, {commit}; "
                "--allow-dirty ships it nevertheless"
            )


def require_unseen(info: CheckpointInfo, dataset_hash: str) -> None:
    """Exit where a checkpoint, or the one it started from, was trained on this data."""
    trained_on = {info.dataset_hash, (info.parent or {}).get("dataset_hash")}
    if dataset_hash in trained_on:
        raise SystemExit(
            f"the checkpoint was trained on this data (hash {dataset_hash[:12]}), which would say "
            "nothing of other mugs; --allow-training-data evaluates it nevertheless"
        )


def main(config: EvaluateConfig) -> None:
    """Evaluate, print a table, and write what is asked for."""
    console = Console()
    network, info = load_checkpoint(config.checkpoint or default_weights())
    dataset = MugDataset.open(config.data)
    if config.ship is not None:
        require_shippable(info, config.allow_dirty)
    if not config.allow_training_data:
        require_unseen(info, dataset.dataset_hash)
    metrics = evaluate(SplitDetector(network), dataset, config, console)
    console.print(metrics_table(metrics))
    console.print(f"median time of a detection: {metrics['median_detect_s']:.2f} s")
    if config.out is not None:
        config.out.parent.mkdir(parents=True, exist_ok=True)
        config.out.write_text(json.dumps(metrics, indent=1) + "\n")
    if config.ship is not None:
        save_checkpoint(config.ship, network, replace(info, metrics=metrics))


if __name__ == "__main__":
    main(tyro.cli(EvaluateConfig))
