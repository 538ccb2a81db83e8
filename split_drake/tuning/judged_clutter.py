"""Grasps that a model drew in clutter, judged by geometry.

Scenes are drawn as those that it is trained on, of other seeds; a grasp holds as `ClutterJudge`
says, which takes a hundredth of what physics takes.
"""

import os
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from split_drake.bad_input import require_numbers
from split_drake.data.clutter.scenes import (
    LABEL_VERSION,
    ClutterRecipe,
    ClutterScene,
    ClutterScenes,
)
from split_drake.data.clutter.sizes import clutter_source
from split_drake.data.clutter.views import merged_mesh
from split_drake.experiments.provenance import file_sha256
from split_drake.grasps.clutter_judge import ClutterJudge
from split_drake.pose_task import GRASP
from split_drake.split.detector import ONE_LOOK, SplitDetector
from split_drake.station.layout import Layout
from split_drake.tuning.judged_grasps import (
    Shard,
    judged_scene,
    with_training_noise,
    write_missing,
    write_scenes,
)

# Keeps these scenes apart from those of training, whose seeds have two parts.
_STREAM = 1


@dataclass(frozen=True)
class JudgeClutterConfig:
    """Which grasps to draw and judge, in scenes of the procedural training objects.

    Attributes:
        checkpoint: the model that draws them.
        library: file of `split_drake.data.clutter.library`, of the training objects.
        out: folder to write to.
        shards: how many files.
        scenes_per_shard: how many scenes in each.
        samples: grasps drawn in each scene.
        seed: of all draws, together with the shard's number.
        workers: processes; the outcome does not depend on them.
    """

    checkpoint: Path
    library: Path
    out: Path
    shards: int = 100
    scenes_per_shard: int = 40
    samples: int = 48
    seed: int = 0
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("shards", "scenes_per_shard", "samples", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")

    def names(self) -> list[str]:
        """Return the names of the shards."""
        return [f"clutter_{number:04d}" for number in range(self.shards)]

    def record(self) -> dict[str, Any]:
        """Return what the grasps depend on."""
        return {
            "checkpoint": file_sha256(self.checkpoint),
            "library": file_sha256(self.library),
            "label_version": LABEL_VERSION,
            "langevin": asdict(ONE_LOOK.langevin),
            "scenes_per_shard": self.scenes_per_shard,
            "samples": self.samples,
            "seed": self.seed,
        }


def judge_clutter_scene(
    drawn: ClutterScene, detector: SplitDetector, rng: np.random.Generator
) -> Shard:
    """Return the arrays of one scene."""
    seen = with_training_noise(drawn.scene, rng)
    X_WGs = detector.sample(seen, (GRASP,), rng)[GRASP.name].X_WPs
    mesh_W = merged_mesh(drawn.objects, drawn.X_WOs)
    judge = ClutterJudge(mesh_W, drawn.scene.workspace.p_WCenter[2])
    return judged_scene(drawn.scene, X_WGs, judge.check(X_WGs).good)


def write_judged_clutter(config: JudgeClutterConfig, recipe: ClutterRecipe, name: str) -> None:
    """Draw and judge the grasps of a shard, and write them at once or not at all."""
    sampler = replace(ONE_LOOK, samples=config.samples)
    detector = SplitDetector.from_checkpoint(config.checkpoint, sampler)
    rng = np.random.default_rng([config.seed, config.names().index(name), _STREAM])
    drawn = ClutterScenes(recipe, rng).draw_all()
    scenes = [
        judge_clutter_scene(next(drawn), detector, rng) for _ in range(config.scenes_per_shard)
    ]
    write_scenes(config.out / f"{name}.npz", scenes)


def judge_clutter(config: JudgeClutterConfig, layout: Layout) -> None:
    """Write the shards that are missing."""
    recipe = ClutterRecipe(clutter_source("train"), config.library, layout, seed=config.seed)
    record = config.record() | {"workspace": asdict(layout.workspace)}
    write = partial(write_judged_clutter, config, recipe)
    write_missing(config.out, record, config.names(), write, config.workers)
