"""Grasps that a model drew in clutter, judged by geometry, with the depth image of each scene.

A folder holds ``config.json``, which names the shards, and one ``<shard>.npz`` each, with S scenes
of K grasps:

=========  ============  =======  ===============================================================
array      shape         type     content
=========  ============  =======  ===============================================================
depths     (P,)          uint16   pixels of all images by rows, `DEPTH_UNIT_M` each; 0: none seen
sizes      (S, 2)        int32    rows and columns of the images
focal_px   (S, 2)        float32  along x and y
center_px  (S, 2)        float32  along x and y
X_WCs      (S, 4, 4)     float32  the cameras' poses
sampled    (S, K, 4, 4)  float32  grasps X_WG: the `BEST` by their scores first, then some others
logits     (S, K)        float32  what the model's evaluator said of them
held       (S, K)        bool     whether each holds, as `ClutterJudge` says
=========  ============  =======  ===============================================================

Scenes are those of clutter, also such as have no grasp, as rounds end with them.  A shard depends
on the seed and its number alone; shards that exist are kept.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from split_drake.bad_input import require_count, require_numbers
from split_drake.camera import DepthView
from split_drake.data.clutter.drawing import Objects, arrangements
from split_drake.data.clutter.library import ClutterObject
from split_drake.data.clutter.scenes import LEAST_POINTS, MAX_EMPTY, KeptSource
from split_drake.data.clutter.sizes import clutter_source
from split_drake.data.clutter.views import FINE, ViewRandomization, merged_mesh, see
from split_drake.data.dataset import DatasetError
from split_drake.experiments.provenance import file_sha256
from split_drake.files import replacing
from split_drake.grasps.clutter_judge import LEAST_QUALITY, LEAST_WIDTH_M, ClutterJudge
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.scene import EmptySceneError, Scene
from split_drake.split.detector import ONE_LOOK, SplitDetector
from split_drake.station.layout import Layout
from split_drake.training.augmentation import AugmentationConfig
from split_drake.tuning.judged_grasps import Shard, with_training_noise, write_missing

DEPTH_UNIT_M = 5e-5
_MOST_UNITS = np.iinfo(np.uint16).max
VIEWS = ViewRandomization(intrinsics=FINE)
BEST, OTHERS = 64, 32
# Keeps these scenes apart from those of training and of `judged_clutter`.
_STREAM = 2


@dataclass(frozen=True)
class JudgeViewsConfig:
    """Which grasps to draw and judge, in scenes of the procedural training objects.

    Attributes:
        checkpoint: the model that draws them.
        out: folder to write to.
        shards: how many files.
        scenes_per_shard: how many scenes in each.
        seed: of all draws, together with the shard's number.
        workers: processes; the outcome does not depend on them.
    """

    checkpoint: Path
    out: Path
    shards: int = 100
    scenes_per_shard: int = 60
    seed: int = 0
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("shards", "scenes_per_shard", "workers"):
            require_count(name, getattr(self, name), 1)

    def names(self) -> list[str]:
        """Return the names of the shards."""
        return [f"views_{number:04d}" for number in range(self.shards)]

    def record(self, source: KeptSource, layout: Layout) -> dict[str, Any]:
        """Return what the grasps depend on."""
        return {
            "checkpoint": file_sha256(self.checkpoint),
            "objects": source.sha256(),
            "judge": [LEAST_QUALITY, LEAST_WIDTH_M],
            "views": asdict(VIEWS),
            "noise_m": list(AugmentationConfig().noise_m),
            "sampler": asdict(ONE_LOOK),
            "scenes_per_shard": self.scenes_per_shard,
            "grasps": [BEST, OTHERS],
            "seed": self.seed,
            "workspace": asdict(layout.workspace),
        }


@dataclass(frozen=True)
class SeenClutter:
    """Objects where they lie, and what a camera with a fine image sees of them.

    Attributes:
        scene: what is seen, without noise.
        objects: K of them.
        X_WOs: (K, 4, 4) how they lie.
    """

    scene: Scene
    objects: Sequence[ClutterObject]
    X_WOs: Array

    @property
    def view(self) -> DepthView:
        """The depth image."""
        return self.scene.views[0]


def seen_clutter(
    objects: Objects, layout: Layout, rng: np.random.Generator
) -> Iterator[SeenClutter]:
    """Yield scenes without end; such as show hardly anything are left out.

    Raises DatasetError where many in a row do.
    """
    empty = 0
    for drawn, arrangement in arrangements(objects, layout, rng):
        there = [drawn[number] for number in arrangement.numbers]
        with suppress(EmptySceneError):
            scene, _ = see(there, arrangement.X_WOs, layout.workspace, VIEWS, rng)
            if len(scene.p_WPs) >= LEAST_POINTS:
                empty = 0
                yield SeenClutter(scene, there, arrangement.X_WOs)
                continue
        empty += 1
        if empty == MAX_EMPTY:
            raise DatasetError(f"{MAX_EMPTY} arrangements in a row show hardly anything")


def judged_view(seen: SeenClutter, detector: SplitDetector, rng: np.random.Generator) -> Shard:
    """Return the arrays of one scene."""
    noisy = with_training_noise(seen.scene, rng)
    drawn = detector.sample(noisy, (GRASP,), rng)[GRASP.name]
    order = np.argsort(-drawn.scores, kind="stable")
    chosen = np.r_[order[:BEST], rng.permutation(order[BEST:])[:OTHERS]]
    X_WGs, scores = drawn.X_WPs[chosen], drawn.scores[chosen].clip(1e-9, 1.0 - 1e-9)
    judge = ClutterJudge(merged_mesh(seen.objects, seen.X_WOs), seen.scene.workspace.p_WCenter[2])
    intrinsics = seen.view.intrinsics
    units = np.round(seen.view.depth_m / DEPTH_UNIT_M)
    return {
        "depths": np.where(units <= _MOST_UNITS, units, 0.0).astype(np.uint16).ravel(),
        "sizes": np.array([intrinsics.height, intrinsics.width], np.int32),
        "focal_px": np.array([intrinsics.fx, intrinsics.fy], np.float32),
        "center_px": np.array([intrinsics.cx, intrinsics.cy], np.float32),
        "X_WCs": seen.view.X_WC.astype(np.float32),
        "sampled": X_WGs.astype(np.float32),
        "logits": np.log(scores / (1.0 - scores)).astype(np.float32),
        "held": judge.check(X_WGs).good,
    }


@lru_cache(maxsize=1)
def _objects(source: KeptSource) -> Objects:
    return Objects(source)


def write_judged_views(
    config: JudgeViewsConfig, source: KeptSource, layout: Layout, name: str
) -> None:
    """Draw and judge the grasps of a shard, and write them at once or not at all."""
    # The second look is what is to be learnt: these grasps are those of the first.
    detector = SplitDetector.from_checkpoint(config.checkpoint, ONE_LOOK)
    rng = np.random.default_rng([config.seed, config.names().index(name), _STREAM])
    drawn = seen_clutter(_objects(source), layout, rng)
    scenes = [judged_view(next(drawn), detector, rng) for _ in range(config.scenes_per_shard)]
    arrays = {
        key: (np.concatenate if key == "depths" else np.stack)([scene[key] for scene in scenes])
        for key in scenes[0]
    }
    with replacing(config.out / f"{name}.npz") as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def judge_views(config: JudgeViewsConfig, layout: Layout) -> None:
    """Write the shards that are missing."""
    source = clutter_source("train")
    write = partial(write_judged_views, config, source, layout)
    write_missing(config.out, config.record(source, layout), config.names(), write, config.workers)
