"""Measure a checkpoint: ``python -m split_drake.evaluation.evaluate --mugs test --out runs/eval``.

Scenes are drawn as the scenarios draw their starts.  `judgement` and `task_records` say what
counts as good, `evaluation` what is written.
"""

import os
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from split_drake.evaluation.evaluation import Evaluation, evaluate
from split_drake.evaluation.examiner import DetectorMaker
from split_drake.evaluation.report.summary import calibration_table, metrics_table, subjects_table
from split_drake.evaluation.scenes import EvalMugs, EvalOptions
from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import UNKNOWN_COMMIT, file_sha256
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import usable_mugs
from split_drake.pose_task import PoseTask, UnknownTaskError
from split_drake.split.checkpoint import (
    CheckpointInfo,
    default_weights,
    load_checkpoint,
    save_checkpoint,
)
from split_drake.split.detector import SAMPLERS, SamplerConfig, SplitDetector
from split_drake.station.layout import Layout


@dataclass(frozen=True, kw_only=True)
class MugEvalOptions(EvalOptions):
    """What the scenes of an evaluation on mugs are.

    Attributes:
        mugs: "train", "test", "thin", or a folder of upright mesh files.
        scenes: how many, spread evenly over the mugs of a split.
        scenes_per_mug: how many of each mug of a folder.
    """

    mugs: str = "test"
    scenes: int = 2000
    scenes_per_mug: int = 200

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("scenes", "scenes_per_mug"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")
        MugSource(self.mugs)

    @cached_property
    def source(self) -> MugSource:
        """Where the mugs come from; those of a folder that are of no use are told, once."""
        workers = len(os.sched_getaffinity(0))
        return usable_mugs(MugSource(self.mugs), workers, Console()).source

    def wanted(self) -> int:
        """Return how many scenes are wanted."""
        if self.source.split is not None:
            return self.scenes
        return self.scenes_per_mug * len(self.source.names())

    def evaluation(
        self,
        make_detector: DetectorMaker,
        detector: dict[str, Any],
        tasks: tuple[PoseTask, ...],
        layout: Layout,
    ) -> Evaluation:
        """Return the evaluation of a detector on these scenes, see `Evaluation`."""
        options = EvalOptions(self.physics_scenes, self.noise_m, self.seed)
        subjects = EvalMugs(self.source, layout)
        return Evaluation(make_detector, detector, tasks, subjects, options, self.wanted())


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig(MugEvalOptions):
    """An evaluation.

    Attributes:
        out: folder to write scenes.jsonl, metrics.json and pictures to; one that holds a part of
            this evaluation is completed.
        checkpoint: weights; those of the project by default.
        evaluations: of the score.
        workers: processes, of one thread each.
        ship: where to write a copy of the checkpoint that records the metrics; none by default.  It
            must come from a known commit.
        allow_dirty: ship it also where the source differed from that commit.
        allow_training_data: evaluate also on the mugs that checkpoints are trained on.
    """

    out: Path
    checkpoint: Path | None = None
    evaluations: Literal[4, 16] = 4
    workers: int = len(os.sched_getaffinity(0))
    ship: Path | None = None
    allow_dirty: bool = False
    allow_training_data: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.workers < 1:
            raise ValueError(f"workers is {self.workers}; expected at least 1")
        if self.evaluations not in SAMPLERS:
            raise ValueError(f"evaluations is {self.evaluations}; expected 4 or 16")


def require_shippable(info: CheckpointInfo, allow_dirty: bool) -> None:
    """Exit where nobody could tell what source trained a checkpoint."""
    for commit in (*info.earlier_commits, info.commit):
        if commit == UNKNOWN_COMMIT:
            raise SystemExit("the checkpoint's commit is unknown: train it from a git checkout")
        if commit.endswith("-dirty") and not allow_dirty:
            raise SystemExit(
                f"the checkpoint was trained by a source that differed from its commit, {commit}; "
                "--allow-dirty ships it nevertheless"
            )


def require_unseen(mugs: str) -> None:
    """Exit where the mugs are those that checkpoints are trained on."""
    if mugs == "train":
        raise SystemExit(
            "checkpoints are trained on the mugs of the train split, which would say nothing of "
            "other mugs; --allow-training-data evaluates on them nevertheless"
        )


def describe_detector(
    checkpoint: Path, info: CheckpointInfo, sampler: SamplerConfig
) -> dict[str, Any]:
    """Return what tells the detector with these weights and settings from others."""
    return {
        "checkpoint_sha256": file_sha256(checkpoint),
        "commit": info.commit,
        "dataset_hash": info.dataset_hash,
        "sampler": asdict(sampler),
    }


def main(config: EvaluateConfig) -> None:
    """Evaluate, print tables, and write what is asked for."""
    console = Console()
    checkpoint, sampler = config.checkpoint or default_weights(), SAMPLERS[config.evaluations]
    network, info = load_checkpoint(checkpoint)
    if config.ship is not None:
        require_shippable(info, config.allow_dirty)
    if not config.allow_training_data:
        require_unseen(config.mugs)
    evaluation = config.evaluation(
        partial(SplitDetector.from_checkpoint, checkpoint, sampler),
        describe_detector(checkpoint, info, sampler),
        info.tasks,
        Layout(workspace=info.workspace),
    )
    try:
        metrics = evaluate(evaluation, config.out, config.workers, console)
    except UnknownTaskError as error:
        raise SystemExit(str(error)) from None
    names = [task.name for task in info.tasks]
    console.print(metrics_table(metrics, names), calibration_table(metrics, names))
    if config.source.split is None:
        console.print(subjects_table(metrics, info.tasks))
    console.print(f"median time of a detection on one thread: {metrics['median_detect_s']:.2f} s")
    if config.ship is not None:
        shown = {key: value for key, value in metrics.items() if key != "by_subject"}
        save_checkpoint(config.ship, network, replace(info, metrics=shown))


if __name__ == "__main__":
    run_command(main, EvaluateConfig)
