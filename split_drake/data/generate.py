"""Generate mug scenes: `python -m split_drake.data.generate --out datasets/mugs_train`.

One shard a mug, seeded by the mug alone, so that neither the number of workers nor an interruption
changes a byte; shards that exist already are kept.  See `dataset` for the format.

Differs from the paper: 50 scenes of each of 200 mugs, 10,000 in all, against 30,000 (more only with
`--scenes-per-mug`); grasps need not be visible in the cloud (the paper wants a point within 5 mm of
where the approach meets the surface); and grasps are judged by geometry (`grasp_judge`), not yet by
holding the mug in physics.
"""

import json
import multiprocessing
import os
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from rich.progress import track

from split_drake.data.dataset import (
    FORMAT_VERSION,
    MANIFEST,
    DatasetError,
    combined_sha256,
    file_sha256,
)
from split_drake.data.grasps import GraspLabels, feasible, sample_grasps
from split_drake.data.mug_parameters import MugParameters, outer_radius_m
from split_drake.data.mugs import load_mug, mug_names, mug_parameters
from split_drake.data.placements import PlacementConfig, RestingPoses
from split_drake.data.render import DepthRenderer
from split_drake.layout import Layout
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.scene import Scene

GRASPS = 128
NEGATIVES = 64
MIN_GRASPS = 8
# A mug of which so many resting poses leave too few grasps isn't one for this hand.
MAX_REDRAWS = 200
# Points this far outside the body's profile lie on the handle.
HANDLE_MARGIN_M = 0.002
CONFIG = "config.json"


@dataclass(frozen=True)
class GenerateConfig:
    """Which scenes to generate.

    Attributes:
        out: folder of the dataset.
        mugs: split to take the shapes from.
        scenes_per_mug: how many scenes of each shape.
        seed: of all draws, together with the mug's number.
        placement: how mugs lie.
        workers: processes; the scenes do not depend on them.
    """

    out: Path
    mugs: Literal["train", "test"] = "train"
    scenes_per_mug: int = 50
    seed: int = 0
    placement: PlacementConfig = field(default_factory=PlacementConfig)
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        for name in ("scenes_per_mug", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")

    def scenes_config(self) -> dict[str, Any]:
        """Return what the scenes depend on."""
        config = asdict(self)
        return {key: config[key] for key in ("mugs", "scenes_per_mug", "seed", "placement")}


class SceneGenerator:
    """Draws scenes of one mug."""

    def __init__(
        self, name: str, placement: PlacementConfig, seeds: np.random.SeedSequence
    ) -> None:
        # Scenes have a stream of their own, so that other labels leave them as they are.
        for_labels, for_scenes = seeds.spawn(2)
        mug = load_mug(name)
        self._mug = mug
        self._parameters = mug_parameters(name)
        self._rng = np.random.default_rng(for_scenes)
        self._layout = Layout()
        self._renderer = DepthRenderer(mug.body.mesh)
        self._labels: GraspLabels = sample_grasps(mug, np.random.default_rng(for_labels))
        self._resting = RestingPoses(
            mug.body.mesh, mug.body.p_OCom, self._layout.workspace, placement
        )

    def draw(self) -> dict[str, np.ndarray]:
        """Return the arrays of one scene in which at least MIN_GRASPS grasps are feasible.

        Raises DatasetError where no resting pose leaves that many, in MAX_REDRAWS draws.
        """
        for _ in range(MAX_REDRAWS):
            X_WO = self._resting.sample(self._rng)
            reachable = feasible(X_WO, self._labels.X_OGs, self._labels.openings_m)
            if reachable.sum() >= MIN_GRASPS:
                return self._label(X_WO, reachable)
        raise DatasetError(
            f"none of {MAX_REDRAWS} resting poses of {self._mug.body.name} leaves {MIN_GRASPS} of "
            f"its {len(self._labels.X_OGs)} grasps feasible"
        )

    def _label(self, X_WO: Array, reachable: np.ndarray) -> dict[str, np.ndarray]:
        views = [self._renderer.render(X_WO, camera) for camera in self._layout.cameras]
        p_WSs = Scene.from_views(views, self._layout.workspace).p_WSs
        return {
            "clouds": p_WSs,
            "X_WOs": X_WO,
            "grasps": X_WO @ self._labels.X_OGs[self._draw_grasps(reachable)],
            "grasp_negatives": X_WO @ self._draw_negatives(reachable),
            "handles": self._mug.handle_poses(X_WO),
            "uprights": X_WO[None],
            "handle_points": np.int32(handle_points(self._parameters, X_WO, p_WSs)),
        }

    def _draw_grasps(self, reachable: np.ndarray) -> np.ndarray:
        weights = self._labels.qualities * reachable
        replace = bool(reachable.sum() < GRASPS)
        return self._rng.choice(len(weights), GRASPS, replace=replace, p=weights / weights.sum())

    def _draw_negatives(self, reachable: np.ndarray) -> Array:
        """Half of them false wherever the mug lies, half true but for how it lies."""
        blocked = self._labels.X_OGs[~reachable]
        false = self._labels.X_OGnegatives
        from_blocked = NEGATIVES // 2 if len(blocked) else 0
        drawn = [false[self._rng.integers(len(false), size=NEGATIVES - from_blocked)]]
        if from_blocked:
            drawn.append(blocked[self._rng.integers(len(blocked), size=from_blocked)])
        return np.concatenate(drawn)


def handle_points(parameters: MugParameters, X_WO: Array, p_WPs: Array) -> int:
    """Return how many points (N, 3) of a mug at X_WO lie outside its body, on the handle."""
    p_OPs = transform_points(invert_pose(X_WO), p_WPs)
    radius_m = outer_radius_m(parameters, p_OPs[:, 2]) + HANDLE_MARGIN_M
    return int((np.hypot(p_OPs[:, 0], p_OPs[:, 1]) > radius_m).sum())


def write_shard(config: GenerateConfig, name: str) -> str:
    """Generate the scenes of mug `name`, write them atomically, and return the mug's name."""
    path = config.out / f"{name}.npz"
    number = int(name.rpartition("_")[2])
    seeds = np.random.SeedSequence([config.seed, number, config.mugs == "test"])
    generator = SceneGenerator(name, config.placement, seeds)
    scenes = [generator.draw() for _ in range(config.scenes_per_mug)]
    arrays = {
        key: np.stack([scene[key] for scene in scenes]).astype(
            np.int32 if key == "handle_points" else np.float32
        )
        for key in scenes[0]
    }
    with tempfile.NamedTemporaryFile(dir=config.out, suffix=".part", delete=False) as file:
        np.savez(file, allow_pickle=False, **arrays)
    Path(file.name).replace(path)
    return name


def _open_folder(config: GenerateConfig) -> None:
    """Make the folder; raise DatasetError where it holds scenes of another configuration."""
    config.out.mkdir(parents=True, exist_ok=True)
    path, scenes_config = config.out / CONFIG, config.scenes_config()
    if path.exists() and (before := json.loads(path.read_text())) != scenes_config:
        raise DatasetError(f"{config.out} holds scenes of {before}; asked for {scenes_config}")
    path.write_text(json.dumps(scenes_config, indent=1) + "\n")


def generate(config: GenerateConfig) -> None:
    """Write the shards that are missing, then the manifest."""
    _open_folder(config)
    names = mug_names(config.mugs)
    missing = [name for name in names if not (config.out / f"{name}.npz").exists()]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(config.workers, mp_context=context) as executor:
        futures = [executor.submit(write_shard, config, name) for name in missing]
        for future in track(as_completed(futures), "shards", total=len(futures)):
            future.result()
    shards = {name: file_sha256(config.out / f"{name}.npz") for name in names}
    manifest = {
        "format_version": FORMAT_VERSION,
        "config": config.scenes_config(),
        "scenes": config.scenes_per_mug * len(names),
        "shards": shards,
        "sha256": combined_sha256(shards),
    }
    (config.out / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")


if __name__ == "__main__":
    generate(tyro.cli(GenerateConfig, description=__doc__))
