"""Grasps that a model drew itself, tried in physics: what its evaluator should say of them.

A folder holds ``config.json`` and one ``<mug>.npz`` a shape, each with S scenes of K grasps:

========  ===============  =======  ==========================================
array     shape            type     content
========  ===============  =======  ==========================================
clouds    (S, 2000, 3)     float32  sampled points without noise, metres in W
sampled   (S, K, 4, 4)     float32  grasps X_WG
held      (S, K)           bool     whether each holds
========  ===============  =======  ==========================================

Scenes are drawn as trials start, from training mugs; a grasp holds as `GraspTrials` says, which is
also what evaluations ask.  A shard depends on the seed and its mug alone; shards that exist are
kept.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track

from split_drake.evaluation.judgement import judge_grasps
from split_drake.evaluation.scenes import EvalMugs, EvalSubject
from split_drake.evaluation.task_records import GraspTrials
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.provenance import file_sha256
from split_drake.experiments.run import CONFIG, claim_folder
from split_drake.files import replacing
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.pose_task import GRASP
from split_drake.scene import Scene, Workspace
from split_drake.split.detector import SamplerConfig, SplitDetector
from split_drake.station.layout import Layout
from split_drake.training.augmentation import AugmentationConfig

Shard = dict[str, np.ndarray]


class JudgedGraspsError(ValueError):
    """A folder holds not all of the judged grasps."""


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
    """Return the arrays of one scene; points are as noisy as any that the model is trained on."""
    scene = mug.draw(rng)
    seen = Scene(scene.p_WPs, scene.p_WSs, workspace)
    seen = seen.with_noise(rng.uniform(*AugmentationConfig().noise_m), rng)
    X_WGs = detector.sample(seen, (GRASP,), rng)[GRASP.name].X_WPs
    judgement = judge_grasps(X_WGs, mug.judge, scene.X_WO)
    trials = GraspTrials(mug.hand, scene.X_WO, X_WGs, judgement)
    held = np.array([not trials.fault(number) for number in range(len(X_WGs))])
    return {
        "clouds": scene.p_WSs.astype(np.float32),
        "sampled": X_WGs.astype(np.float32),
        "held": held,
    }


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
    with replacing(config.out / f"{name}.npz") as temporary:
        np.savez(
            temporary,
            allow_pickle=False,
            **{key: np.stack([scene[key] for scene in scenes]) for key in scenes[0]},
        )


def judge(config: JudgeConfig, names: Sequence[str], layout: Layout) -> None:
    """Write the shards of the training mugs `names` that are missing."""
    claim_folder(config.out, config.record() | {"workspace": asdict(layout.workspace)})
    missing = [name for name in names if not (config.out / f"{name}.npz").exists()]
    start_worker = partial(torch.set_num_threads, 1)
    pool = WorkerPool(
        partial(write_judged, config, layout), config.workers, start_worker=start_worker
    )
    for _ in track(pool.run(missing), "mugs", total=len(missing)):
        pass


@dataclass(frozen=True)
class JudgedGrasps:
    """Judged grasps in memory, the S scenes of all mugs one after another.

    Attributes:
        clouds, sampled, held: see the module.
        mug_index: (S,) which mug each scene shows.
        mugs: how many there are.
        workspace: that the scenes were cropped to.
    """

    clouds: NDArray[np.float32]
    sampled: NDArray[np.float32]
    held: NDArray[np.bool_]
    mug_index: NDArray[np.int_]
    mugs: int
    workspace: Workspace

    @classmethod
    def open(cls, folder: Path, names: Sequence[str]) -> Self:
        """Read the shards of the mugs `names`; raise JudgedGraspsError where some are missing."""
        paths = [folder / f"{name}.npz" for name in names]
        if missing := [path for path in paths if not path.is_file()]:
            raise JudgedGraspsError(
                f"{len(missing)} of {len(paths)} shards are missing, {missing[0]} the first; "
                "judge them first"
            )
        shards = []
        for path in paths:
            with np.load(path, allow_pickle=False) as archive:
                shards.append({key: archive[key] for key in ("clouds", "sampled", "held")})
        arrays = {key: np.concatenate([shard[key] for shard in shards]) for key in shards[0]}
        index = np.repeat(np.arange(len(names)), [len(shard["held"]) for shard in shards])
        workspace = Workspace.from_fields(_read_config(folder)["workspace"])
        return cls(**arrays, mug_index=index, mugs=len(names), workspace=workspace)


def _read_config(folder: Path) -> dict[str, Any]:
    """Return what the folder's grasps were judged with; JudgedGraspsError where it does not say."""
    path = folder / CONFIG
    config = json.loads(path.read_text()) if path.is_file() else {}
    if "workspace" not in config:
        raise JudgedGraspsError(f"{path} does not say which workspace the scenes are of")
    return dict(config)
