"""Generate mug scenes: `python -m split_drake.data.generate --out datasets/mugs_train`.

One shard a mug, seeded by the mug alone, so that neither the number of workers nor an interruption
changes a byte; shards that exist already are kept.  See `dataset` for the format.

This is the paper's protocol (section V): candidates at the object level, validated in physics
(`grasp_store`), attached to the object, and placed in scenes; there they must clear the table, come
from above, and be visible (`grasp_candidates`, `visibility`); those that fail are kept as false.
200 shapes with 150 scenes each make its 30,000 scenes.  It differs from the paper:

- Shapes come from a parametric family in place of ShapeNet, where the paper picks 25 mugs to train
  on.  Handle and upright poses follow from the shape; the paper annotates them by hand.
- Mugs lie as they came to rest in 24 drops a shape (`rests`), turned and moved; 15% stand upright.
- Physics tries each grasp once on the object alone, in a free hand, and not again in each scene.
- Of a free pinch between clearly weak and firm nothing is said: it is neither true nor false.
- Where the approach meets nothing within reach, seeing a contact of the pads is enough.
- Scenes with fewer than 8 true grasps are drawn again; the manifest says how many were.
- Cameras, table and missing pixels are randomised (`randomization`), which the paper names as
  future work; the points' noise is added in training.  The paper has two views of all mug scenes.
"""

import os
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.progress import track

from split_drake.data.dataset import FORMAT_VERSION, MANIFEST, read_shard, write_shard
from split_drake.data.grasp_candidates import GraspCandidates, GraspState
from split_drake.data.handle_points import VISIBLE_HANDLE_POINTS
from split_drake.data.mug_scenes import MugScenes
from split_drake.data.randomization import DomainRandomization
from split_drake.data.rests import load_rests, rests_path
from split_drake.data.scene_generator import SceneGenerator
from split_drake.experiments.pool import InThisProcess, WorkerPool
from split_drake.experiments.provenance import combined_sha256, file_sha256
from split_drake.experiments.run import claim_folder
from split_drake.files import write_json
from split_drake.grasps.store import load_checked_grasps, store_path
from split_drake.objects.mugs.split import Split, load_mug, mug_names, mugs_sha256
from split_drake.station.layout import Layout

# Raise it when code changes what scenes or labels come out of the same files and settings.
LABEL_VERSION = 2


@dataclass(frozen=True)
class GenerateConfig:
    """Which scenes to generate.

    Attributes:
        out: folder of the dataset.
        mugs: split to take the shapes from.
        scenes_per_mug: how many scenes of each shape.
        seed: of all draws, together with the mug's number.
        randomization: what varies from scene to scene.
        workers: processes, 1 for this one alone; the scenes do not depend on them.
    """

    out: Path
    mugs: Split = "train"
    scenes_per_mug: int = 150
    seed: int = 0
    randomization: DomainRandomization = field(default_factory=DomainRandomization)
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        for name in ("scenes_per_mug", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")

    def scenes_config(self) -> dict[str, Any]:
        """Return all that the scenes depend on."""
        layout = Layout()
        return {
            "mugs": self.mugs,
            "scenes_per_mug": self.scenes_per_mug,
            "seed": self.seed,
            "randomization": asdict(self.randomization),
            "workspace": asdict(layout.workspace),
            "cameras": [asdict(camera) for camera in layout.cameras],
            "sources": source_hashes(self.mugs),
            "label_version": LABEL_VERSION,
        }


def source_hashes(split: Split) -> dict[str, str]:
    """Return the SHA-256 of each file that the scenes of a split are made from."""
    return {
        "mugs": mugs_sha256(split),
        "grasps": file_sha256(store_path(split)),
        "rests": file_sha256(rests_path(split)),
    }


def generate_shard(config: GenerateConfig, name: str) -> None:
    """Generate the scenes of mug `name` and write them."""
    number = int(name.rpartition("_")[2])
    seeds = np.random.SeedSequence([config.seed, number, config.mugs == "test"])
    # Scenes have a stream of their own, so that other candidates leave the poses as they are.
    for_candidates, for_scenes = (np.random.default_rng(part) for part in seeds.spawn(2))
    mug, layout = load_mug(name), Layout()
    candidates = GraspCandidates.from_checked(mug, load_checked_grasps(name), for_candidates)
    scenes = MugScenes(mug, load_rests(name), layout, config.randomization)
    generator = SceneGenerator(scenes, candidates, layout.workspace, for_scenes)
    write_shard(config.out / f"{name}.npz", generator.shard(config.scenes_per_mug))


def summarize(folder: Path, names: tuple[str, ...]) -> dict[str, float]:
    """Return what the scenes of these shards are like, for the manifest."""
    shards = [read_shard(folder / f"{name}.npz") for name in names]
    handle_points = np.concatenate([shard["handle_points"] for shard in shards])
    views = np.concatenate([shard["views"] for shard in shards])
    true = [(shard["grasp_states"] == GraspState.TRUE).sum(axis=1) for shard in shards]
    return {
        "scenes": len(views),
        "redraws_for_want_of_grasps": sum(int(shard["redraws"]) for shard in shards),
        "single_view_share": round(float((views == 1).mean()), 4),
        "hidden_handle_share": round(float((handle_points < VISIBLE_HANDLE_POINTS).mean()), 4),
        "median_true_grasps": float(np.median(np.concatenate(true))),
    }


def generate(config: GenerateConfig) -> None:
    """Write the shards that are missing, then the manifest."""
    scenes_config = claim_folder(config.out, config.scenes_config())
    names = mug_names(config.mugs)
    missing = [name for name in names if not (config.out / f"{name}.npz").exists()]
    make = partial(generate_shard, config)
    pool = InThisProcess(make) if config.workers == 1 else WorkerPool(make, config.workers)
    for _ in track(pool.run(missing), "shards", total=len(missing)):
        pass
    shards = {name: file_sha256(config.out / f"{name}.npz") for name in names}
    manifest = {
        "format_version": FORMAT_VERSION,
        "config": scenes_config,
        **summarize(config.out, names),
        "shards": shards,
        "sha256": combined_sha256(shards),
    }
    write_json(config.out / MANIFEST, manifest)


if __name__ == "__main__":
    generate(tyro.cli(GenerateConfig, description=__doc__))
