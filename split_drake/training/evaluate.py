"""Measure a checkpoint: ``python -m split_drake.training.evaluate --data datasets/mugs_test``.

A handle or upright pose counts as good within 1 cm and 15 degrees of a true one, a grasp where it
would hold the mug geometrically and collides with neither mug nor table.
"""

import json
import time
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from split_drake.data.dataset import MugDataset
from split_drake.data.grasp_judge import GraspJudge, feasible
from split_drake.data.mugs import load_mug
from split_drake.pose_set import PoseTask
from split_drake.poses import Array, invert_pose, rotation_error_rad
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import default_weights, load_checkpoint, save_checkpoint
from split_drake.split.detector import SplitDetector
from split_drake.split.network import TASKS

GOOD_POSITION_M = 0.01
GOOD_ROTATION_RAD = np.radians(15.0)
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
        ship: where to write a copy of the checkpoint that records the metrics; none by default.
    """

    data: Path
    checkpoint: Path | None = None
    scenes: int = 200
    noise_m: float = 0.005
    seed: int = 0
    out: Path | None = None
    ship: Path | None = None


@dataclass(frozen=True)
class Judgement:
    """How a task's samples in one scene compare with the truth.

    Attributes:
        good: (N,) whether each sample is.
        position_m, rotation_rad: (N,) errors to the nearest true pose; empty for grasps, of which
            the data set lists only some.
    """

    good: NDArray[np.bool_]
    position_m: Array
    rotation_rad: Array


@cache
def _grasp_judge(mug_name: str) -> GraspJudge:
    return GraspJudge(load_mug(mug_name).body.mesh)


def judge_poses(X_WPs: Array, X_WTruths: Array) -> Judgement:
    """Compare poses (N, 4, 4) with equivalent true poses (M, 4, 4), each with the nearest."""
    position = np.linalg.norm(X_WPs[:, None, :3, 3] - X_WTruths[None, :, :3, 3], axis=-1)
    rotation = rotation_error_rad(X_WPs[:, None, :3, :3], X_WTruths[None, :, :3, :3])
    good = (position < GOOD_POSITION_M) & (rotation < GOOD_ROTATION_RAD)
    nearest = np.argmin(position / GOOD_POSITION_M + rotation / GOOD_ROTATION_RAD, axis=1)
    rows = np.arange(len(X_WPs))
    return Judgement(good.any(axis=1), position[rows, nearest], rotation[rows, nearest])


def judge_grasps(X_WGs: Array, judge: GraspJudge, X_WO: Array) -> Judgement:
    """Check grasps (N, 4, 4) of the object of `judge`, at X_WO, geometrically."""
    X_OGs = invert_pose(X_WO) @ X_WGs
    check = judge.check(X_OGs)
    good = check.good & feasible(X_WO, X_OGs, check.openings_m)
    return Judgement(good, np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class TaskOutcome:
    """A task in one scene.

    Attributes:
        top_good: whether the top-ranked sample is good.
        top_position_m, top_rotation_rad: its errors; NaN for grasps.
        good_share: share of all samples, before any is rejected, that are good.
        kept: samples that the evaluator does not reject.
        kept_good_share: share of those that are good; NaN where none is left.
        handle_visible: whether the cloud shows the handle.
    """

    top_good: bool
    top_position_m: float
    top_rotation_rad: float
    good_share: float
    kept: int
    kept_good_share: float
    handle_visible: bool


def _outcome(scores: Array, judgement: Judgement, threshold: float, visible: bool) -> TaskOutcome:
    """Summarise a task's samples in one scene."""
    top = int(np.argmax(scores))
    kept = scores >= threshold
    measured = judgement.position_m.size > 0
    return TaskOutcome(
        top_good=bool(judgement.good[top]),
        top_position_m=float(judgement.position_m[top]) if measured else np.nan,
        top_rotation_rad=float(judgement.rotation_rad[top]) if measured else np.nan,
        good_share=float(judgement.good.mean()),
        kept=int(kept.sum()),
        kept_good_share=float(judgement.good[kept].mean()) if kept.any() else np.nan,
        handle_visible=visible,
    )


def _mean(values: list[float]) -> float | None:
    """Return the mean of the values that are not NaN, None where there are none."""
    measured = [value for value in values if not np.isnan(value)]
    return float(np.mean(measured)) if measured else None


def _median(values: list[float], unit: float = 1.0) -> float | None:
    """Return the median, in `unit`s, of the values that are not NaN, None where there are none."""
    measured = [value for value in values if not np.isnan(value)]
    return float(np.median(measured)) / unit if measured else None


def summarize(outcomes: list[TaskOutcome]) -> dict[str, float | None]:
    """Return means and medians over scenes; None stands for what was not measured."""
    return {
        "top_good": _mean([o.top_good for o in outcomes]),
        "top_good_handle_visible": _mean([o.top_good for o in outcomes if o.handle_visible]),
        "top_good_handle_hidden": _mean([o.top_good for o in outcomes if not o.handle_visible]),
        "median_position_mm": _median([o.top_position_m for o in outcomes], 1e-3),
        "median_rotation_deg": _median([o.top_rotation_rad for o in outcomes], np.pi / 180.0),
        "samples_good": _mean([o.good_share for o in outcomes]),
        "kept_good": _mean([o.kept_good_share for o in outcomes]),
        "median_kept": _median([o.kept for o in outcomes]),
        "none_kept": _mean([o.kept == 0 for o in outcomes]),
    }


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
    """Return {task: summary, ...} over scenes spread evenly over `dataset`."""
    outcomes: dict[PoseTask, list[TaskOutcome]] = {task: [] for task in TASKS}
    durations_s = []
    chosen = np.linspace(0, len(dataset.clouds) - 1, config.scenes).round().astype(int).tolist()
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
                _outcome(drawn.scores, judgement, detector.config.threshold, visible)
            )
    return {
        **{str(task): summarize(outcomes[task]) for task in TASKS},
        "scenes": len(chosen),
        "scenes_handle_visible": sum(o.handle_visible for o in outcomes[PoseTask.HANDLE]),
        "noise_m": config.noise_m,
        "samples": detector.config.samples,
        "threshold": detector.config.threshold,
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


def main(config: EvaluateConfig) -> None:
    """Evaluate, print a table, and write what is asked for."""
    console = Console()
    network, info = load_checkpoint(config.checkpoint or default_weights())
    detector = SplitDetector(network)
    metrics = evaluate(detector, MugDataset.open(config.data), config, console)
    console.print(metrics_table(metrics))
    console.print(f"median time of a detection: {metrics['median_detect_s']:.2f} s")
    if config.out is not None:
        config.out.parent.mkdir(parents=True, exist_ok=True)
        config.out.write_text(json.dumps(metrics, indent=1) + "\n")
    if config.ship is not None:
        save_checkpoint(config.ship, network, replace(info, metrics=metrics))


if __name__ == "__main__":
    main(tyro.cli(EvaluateConfig))
