"""Grasps that a model drew on training mugs, tried in physics.

Scenes are drawn as trials start; a grasp holds as `GraspTrials` says, which is also what
evaluations ask.  Each shard holds the scenes of one mug.
"""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from split_drake.bad_input import require_numbers
from split_drake.evaluation.judgement import judge_grasps
from split_drake.evaluation.scenes import EvalMugs, EvalSubject
from split_drake.evaluation.task_records import GraspTrials
from split_drake.experiments.provenance import file_sha256
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.pose_task import GRASP
from split_drake.scene import Scene, Workspace
from split_drake.split.detector import SamplerConfig, SplitDetector
from split_drake.station.layout import Layout
from split_drake.tuning.judged_grasps import (
    Shard,
    judged_scene,
    with_training_noise,
    write_missing,
    write_scenes,
)


@dataclass(frozen=True)
class JudgeConfig:
    """Which grasps to draw and try; 0.1 to 0.2 s of CPU each.

    Attributes:
        checkpoint: the model that draws them.
        out: folder to write to.
        scenes_per_mug: how many scenes of each training mug.
        samples: grasps drawn in each scene.
        seed: of all draws, together with the mug's number.
        workers: processes; the outcome does not depend on them.
    """

    checkpoint: Path
    out: Path
    scenes_per_mug: int = 10
    samples: int = 16
    seed: int = 0
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("scenes_per_mug", "samples", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")

    def record(self) -> dict[str, Any]:
        """Return what the grasps depend on."""
        return {
            "checkpoint": file_sha256(self.checkpoint),
            "scenes_per_mug": self.scenes_per_mug,
            "samples": self.samples,
            "seed": self.seed,
        }


def judge_scene(
    mug: EvalSubject, detector: SplitDetector, workspace: Workspace, rng: np.random.Generator
) -> Shard:
    """Return the arrays of one scene."""
    scene = mug.draw(rng)
    seen = Scene(scene.p_WPs, scene.p_WSs, workspace)
    X_WGs = detector.sample(with_training_noise(seen, rng), (GRASP,), rng)[GRASP.name].X_WPs
    judgement = judge_grasps(X_WGs, mug.judge, scene.X_WO, scene.table_z_m)
    trials = GraspTrials(mug.hand, scene.X_WO, X_WGs, judgement)
    held = np.array([not trials.fault(number) for number in range(len(X_WGs))])
    return judged_scene(seen, X_WGs, held)


def write_judged(config: JudgeConfig, layout: Layout, name: str) -> None:
    """Draw and try the grasps of training mug `name`, and write them at once or not at all."""
    sampler = SamplerConfig(samples=config.samples)
    detector = SplitDetector.from_checkpoint(config.checkpoint, sampler)
    mugs = EvalMugs(MugSource("train"), layout)
    number = list(mugs.names()).index(name)
    mug, rng = mugs.make(number, config.seed), np.random.default_rng([config.seed, number])
    scenes = [
        judge_scene(mug, detector, layout.workspace, rng) for _ in range(config.scenes_per_mug)
    ]
    write_scenes(config.out / f"{name}.npz", scenes)


def judge(config: JudgeConfig, names: Sequence[str], layout: Layout) -> None:
    """Write the shards of the training mugs `names` that are missing."""
    record = config.record() | {"workspace": asdict(layout.workspace)}
    write = partial(write_judged, config, layout)
    write_missing(config.out, record, names, write, config.workers)
