"""Generate labelled scenes of clutter: `python -m split_drake.data.clutter.generate --out DIR`.

Shards of `SCENES_PER_SHARD` scenes, each seeded by its number alone; those that exist are kept.
About half of a shard's scenes are packed, the others are piles as they grow.  Each is seen by one
camera from a random side.  Labels are grasps in the scene (`labels`), of objects' own grasps
(`library`); a subject of the dataset is all that lies in a scene.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.progress import track

from split_drake.bad_input import require_numbers
from split_drake.data.clutter.labels import FALSE_KEPT, TRUE_KEPT
from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScene, ClutterScenes
from split_drake.data.clutter.sizes import clutter_source
from split_drake.data.dataset import (
    FORMAT_VERSION,
    MANIFEST,
    Shard,
    encode_points,
    read_shard,
    write_shard,
)
from split_drake.data.labels import PoseState
from split_drake.data.object_scenes import NO_FEATURE
from split_drake.experiments.command import run_command
from split_drake.experiments.pools import LOCAL, require_scheduler, shard_pool
from split_drake.experiments.provenance import combined_sha256, file_sha256
from split_drake.experiments.run import claim_folder
from split_drake.files import write_json
from split_drake.pose_task import GRASP
from split_drake.station.layout import Layout

SCENES_PER_SHARD = 200


def shard_of(scenes: Sequence[ClutterScene]) -> Shard:
    """Return the arrays of a shard, see `split_drake.data.dataset`; each scene is a subject."""
    count, most = len(scenes), TRUE_KEPT + FALSE_KEPT
    X_WGs = np.zeros((count, most, 4, 4), np.float32)
    weights = np.zeros((count, most), np.float32)
    states = np.full((count, most), PoseState.PADDING, np.uint8)
    for number, each in enumerate(scenes):
        true, false = each.grasps.X_WGs, each.grasps.X_WFs
        X_WGs[number, : len(true)] = true
        X_WGs[number, len(true) : len(true) + len(false)] = false
        weights[number, : len(true)] = np.maximum(each.grasps.weights, 1e-3)
        states[number, : len(true)] = PoseState.TRUE
        states[number, len(true) : len(true) + len(false)] = PoseState.FALSE
    workspace = scenes[0].scene.workspace
    return {
        "points": encode_points(np.stack([each.scene.p_WSs for each in scenes]), workspace),
        "X_WOs": np.tile(np.eye(4, dtype=np.float32), (count, 1, 1)),
        "subjects": np.arange(count, dtype=np.int32),
        "p_WCs": np.stack([each.p_WC for each in scenes]).astype(np.float32),
        "feature_points": np.full(count, NO_FEATURE, np.int32),
        "views": np.ones(count, np.uint8),
        "redraws": np.array(0, np.int32),
        f"{GRASP}/X_OPs": X_WGs,
        f"{GRASP}/weights": weights,
        f"{GRASP}/states": states,
    }


def generate_shard(recipe: ClutterRecipe, out: Path, number: int) -> None:
    """Generate shard `number` and write it."""
    scenes = ClutterScenes(recipe, np.random.default_rng([recipe.seed, number])).draw_all()
    drawn = [next(scenes) for _ in range(SCENES_PER_SHARD)]
    write_shard(out / _name(number), shard_of(drawn))


def _name(number: int) -> str:
    return f"clutter_{number:05d}.npz"


def generate(
    recipe: ClutterRecipe, out: Path, shards: int, workers: int, scheduler: str = LOCAL
) -> None:
    """Write the shards that are missing to the folder `out`, then the manifest.

    Raises AnotherRunError where the folder holds scenes of another recipe.
    """
    make = partial(generate_shard, recipe, out)
    with claim_folder(out, recipe.config()) as config:
        missing = [number for number in range(shards) if not (out / _name(number)).exists()]
        pool = shard_pool(scheduler, workers, make, out)
        for _ in track(pool.run(missing), "shards", total=len(missing)):
            pass
        write_manifest(out, config)


def write_manifest(out: Path, config: dict[str, Any]) -> None:
    """Write the manifest of all shards that lie in a folder."""
    paths = sorted(out.glob("clutter_*.npz"))
    hashes = {path.stem: file_sha256(path) for path in paths}
    states = [read_shard(path, (GRASP,))[f"{GRASP}/states"] for path in paths]
    true = np.concatenate([(each == PoseState.TRUE).sum(axis=1) for each in states])
    manifest = {
        "format_version": FORMAT_VERSION,
        "config": config,
        "scenes": len(true),
        "median_true_poses": {GRASP.name: float(np.median(true))},
        "shards": hashes,
        "sha256": combined_sha256(hashes),
    }
    write_json(out / MANIFEST, manifest)


@dataclass(frozen=True)
class ClutterOptions:
    """Which scenes to generate.

    Attributes:
        out: folder of the dataset.
        library: file of `split_drake.data.clutter.library`, of the same objects.
        objects: split of the procedural objects.
        scenes: how many, a multiple of 200.
        seed: of all draws.
        workers: processes, 1 for this one alone; the scenes do not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
    """

    out: Path
    library: Path
    objects: Literal["train", "test"] = "train"
    scenes: int = 30_000
    seed: int = 0
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.scenes < SCENES_PER_SHARD or self.scenes % SCENES_PER_SHARD:
            raise ValueError(
                f"scenes is {self.scenes}; expected a multiple of {SCENES_PER_SHARD}, at least one"
            )
        if self.workers < 1:
            raise ValueError(f"workers is {self.workers}; expected at least 1")


def main(options: ClutterOptions) -> None:
    """Generate the scenes that the command asks for."""
    require_scheduler(options.scheduler)
    recipe = ClutterRecipe(
        clutter_source(options.objects), options.library, Layout(), seed=options.seed
    )
    shards = options.scenes // SCENES_PER_SHARD
    generate(recipe, options.out, shards, options.workers, options.scheduler)


if __name__ == "__main__":
    run_command(main, ClutterOptions, __doc__)
