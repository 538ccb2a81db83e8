"""Generate labelled scenes of clutter: `python -m split_drake.data.clutter.generate --out DIR`.

Shards of `SCENES_PER_SHARD` scenes, each seeded by its number alone; those that exist are kept.
About half of a shard's scenes are packed, the others are piles as they grow.  Each is seen by one
camera from a random side.  Labels are grasps in the scene (`labels`), of objects' own grasps
(`library`); a subject of the dataset is all that lies in a scene.
"""

import os
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
import tyro
from rich.progress import track

from split_drake.data.clutter.arrangements import Arrangement, packed, subsets
from split_drake.data.clutter.labels import FALSE_KEPT, TRUE_KEPT, SceneGrasps, label_scene
from split_drake.data.clutter.library import ClutterObject, GraspLibrary
from split_drake.data.clutter.piles import PileSimulator
from split_drake.data.clutter.sizes import clutter_source
from split_drake.data.clutter.views import ViewRandomization, see
from split_drake.data.dataset import (
    FORMAT_VERSION,
    MANIFEST,
    DatasetError,
    Shard,
    encode_points,
    read_shard,
    write_shard,
)
from split_drake.data.labels import PoseState
from split_drake.data.object_scenes import NO_FEATURE
from split_drake.experiments.pool import InThisProcess, WorkerPool
from split_drake.experiments.provenance import combined_sha256, file_sha256
from split_drake.experiments.run import claim_folder
from split_drake.files import write_json
from split_drake.objects.task_object import ObjectSource
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.scene import EmptySceneError, Scene
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_to_fields

LABEL_VERSION = 3
SCENES_PER_SHARD = 200
PILE_SHARE = 0.5
# Objects in a scene at most.
MOST_OBJECTS = 6
# A scene that shows less, or holds fewer true grasps, teaches little.
LEAST_POINTS, LEAST_TRUE, LEAST_FALSE = 150, 3, 1
# Piles are simulated with a longer step than trials: nothing is held.
PILE_STEP_S = 0.004
MAX_EMPTY = 2000


class KeptSource(ObjectSource, Hashable, Protocol):
    """A source whose objects a process keeps once it has made them."""


@dataclass(frozen=True)
class ClutterRecipe:
    """What clutter scenes are made of; pickled by worker processes.

    Attributes:
        source: of the objects.
        library: file of their grasps.
        layout: of table and workspace; cameras are drawn.
        views: from where scenes are seen.
        seed: of all draws, together with the shard's number.
    """

    source: KeptSource
    library: Path
    layout: Layout
    views: ViewRandomization = field(default_factory=ViewRandomization)
    seed: int = 0

    def config(self) -> dict[str, Any]:
        """Return all that the scenes depend on."""
        return {
            "objects": self.source.sha256(),
            "tasks": [asdict(GRASP)],
            "seed": self.seed,
            "views": asdict(self.views),
            "layout": layout_to_fields(self.layout),
            "library_sha256": file_sha256(self.library),
            "label_version": LABEL_VERSION,
        }

    def objects(self) -> "Objects":
        """Return the objects with their grasps, kept in this process."""
        return _objects(self.source, self.library)


class Objects:
    """Objects of a source, made when they are first wanted.

    Those without a grasp lie there as well: they have to be told from others.
    """

    def __init__(self, source: ObjectSource, library: GraspLibrary) -> None:
        self._source = source
        self._grasps = library.grasps
        self._names = list(library.grasps)
        self._made: dict[str, ClutterObject] = {}

    def draw(self, count: int, rng: np.random.Generator) -> list[ClutterObject]:
        """Return objects drawn with replacement."""
        return [self._get(self._names[n]) for n in rng.integers(len(self._names), size=count)]

    def _get(self, name: str) -> ClutterObject:
        if name not in self._made:
            self._made[name] = ClutterObject(self._source.load(name), self._grasps[name])
        return self._made[name]


@lru_cache(maxsize=1)
def _objects(source: KeptSource, library: Path) -> Objects:
    return Objects(source, GraspLibrary.load(library, source))


@dataclass(frozen=True)
class ClutterScene:
    """A labelled scene.

    Attributes:
        scene: what is seen.
        p_WC: (3,) where the camera stands.
        grasps: in it.
        objects: that are there, K.
        X_WOs: (K, 4, 4) how they lie.
    """

    scene: Scene
    p_WC: Array
    grasps: SceneGrasps
    objects: tuple[ClutterObject, ...]
    X_WOs: Array


class ClutterScenes:
    """Draws labelled scenes of clutter.

    Args:
        recipe: of the scenes.
        rng: what they are drawn from.
    """

    def __init__(self, recipe: ClutterRecipe, rng: np.random.Generator) -> None:
        self._recipe = recipe
        self._rng = rng
        self._objects = recipe.objects()
        layout = recipe.layout
        self._pile_config = StationConfig(layout, time_step_s=PILE_STEP_S)

    def draw_all(self) -> Iterator[ClutterScene]:
        """Yield scenes without end: of packed objects, and of piles as they grow.

        Raises DatasetError where nothing useful comes of many arrangements.
        """
        empty = 0
        for objects, arrangement in self._arrangements():
            scene = self._labelled(objects, arrangement)
            if scene is not None:
                empty = 0
                yield scene
                continue
            empty += 1
            if empty == MAX_EMPTY:
                raise DatasetError(f"{MAX_EMPTY} arrangements in a row show no grasp")

    def _arrangements(self) -> Iterator[tuple[list[ClutterObject], Arrangement]]:
        rng, workspace = self._rng, self._recipe.layout.workspace
        piled = standing = 0
        while True:
            objects = self._objects.draw(int(rng.integers(1, MOST_OBJECTS + 1)), rng)
            if piled < PILE_SHARE * (piled + standing + 1):
                for arrangement in self._pile(objects):
                    piled += 1
                    yield objects, arrangement
            else:
                whole = packed(objects, workspace, rng)
                # With fewer objects, too: rounds end with one.
                every = list(subsets(whole))
                for number in dict.fromkeys((len(every) - 1, int(rng.integers(len(every))))):
                    standing += 1
                    yield objects, every[number]

    def _pile(self, objects: Sequence[ClutterObject]) -> Iterator[Arrangement]:
        try:
            yield from PileSimulator(objects, self._pile_config).drop_all(self._rng)
        except RuntimeError:  # Drake's contact solver: what fell before is seen already
            return

    def _labelled(
        self, objects: Sequence[ClutterObject], arrangement: Arrangement
    ) -> ClutterScene | None:
        there = tuple(objects[number] for number in arrangement.numbers)
        workspace = self._recipe.layout.workspace
        try:
            scene, p_WC = see(there, arrangement.X_WOs, workspace, self._recipe.views, self._rng)
        except EmptySceneError:
            return None
        if len(scene.p_WPs) < LEAST_POINTS:
            return None
        grasps = label_scene(there, arrangement.X_WOs, scene.p_WPs, self._rng)
        grasps = _inside(grasps, scene)
        if len(grasps.X_WGs) < LEAST_TRUE or len(grasps.X_WFs) < LEAST_FALSE:
            return None
        return ClutterScene(scene, p_WC, grasps, there, arrangement.X_WOs)


def _inside(grasps: SceneGrasps, scene: Scene) -> SceneGrasps:
    """Return the grasps whose frames lie in the scene's cube."""

    def within(X_WGs: Array) -> np.ndarray:
        p_VGs = X_WGs[:, :3, 3] - scene.workspace.p_WV
        return np.all((p_VGs > 0.0) & (p_VGs < scene.workspace.edge_m), axis=1)

    kept = within(grasps.X_WGs)
    return replace(
        grasps,
        X_WGs=grasps.X_WGs[kept],
        weights=grasps.weights[kept],
        X_WFs=grasps.X_WFs[within(grasps.X_WFs)],
    )


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


def generate(recipe: ClutterRecipe, out: Path, shards: int, workers: int) -> None:
    """Write the shards that are missing to the folder `out`, then the manifest.

    Raises AnotherRunError where the folder holds scenes of another recipe.
    """
    config = claim_folder(out, recipe.config())
    missing = [number for number in range(shards) if not (out / _name(number)).exists()]
    make = partial(generate_shard, recipe, out)
    pool = InThisProcess(make) if workers == 1 else WorkerPool(make, workers)
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
    """

    out: Path
    library: Path
    objects: Literal["train", "test"] = "train"
    scenes: int = 30_000
    seed: int = 0
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        if self.scenes < SCENES_PER_SHARD or self.scenes % SCENES_PER_SHARD:
            raise ValueError(
                f"scenes is {self.scenes}; expected a multiple of {SCENES_PER_SHARD}, at least one"
            )
        if self.workers < 1:
            raise ValueError(f"workers is {self.workers}; expected at least 1")


def main(options: ClutterOptions) -> None:
    """Generate the scenes that the command asks for."""
    recipe = ClutterRecipe(
        clutter_source(options.objects), options.library, Layout(), seed=options.seed
    )
    generate(recipe, options.out, options.scenes // SCENES_PER_SHARD, options.workers)


if __name__ == "__main__":
    main(tyro.cli(ClutterOptions, description=__doc__))
