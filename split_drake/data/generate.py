"""Generate labelled scenes: `python -m split_drake.data.generate --out datasets/mugs_train`.

The command makes scenes of mugs; `generate` makes those of any `DatasetRecipe`.

One shard an object, seeded by the object alone, so that neither the number of workers nor an
interruption changes a byte; shards that exist already are kept.  See `dataset` for the format.

For mugs this is the paper's protocol (section V): candidates at the object level, validated in
physics (`split_drake.grasps.store`), attached to the object, and placed in scenes; there they must
clear the table, come from above, and be visible (`grasp_candidates`); those that fail are kept as
false.
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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.data.dataset import FORMAT_VERSION, MANIFEST, read_shard, write_shard
from split_drake.data.grasp_candidates import GraspCandidates
from split_drake.data.labels import FixedPoses, PoseLabels, PoseState
from split_drake.data.object_scenes import ObjectScenes, feature_visible
from split_drake.data.randomization import DomainRandomization
from split_drake.data.rests import Rests, rests_in, rests_path
from split_drake.data.scene_generator import SceneGenerator
from split_drake.experiments.command import run_command
from split_drake.experiments.pools import LOCAL, require_scheduler, shard_pool
from split_drake.experiments.provenance import combined_sha256, file_sha256, qualified_name
from split_drake.experiments.run import claim_folder
from split_drake.files import write_json
from split_drake.grasps.store import grasps_in, store_path
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import usable_mugs
from split_drake.objects.task_object import ObjectSource, TaskObject
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import read_station
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_to_fields

# Raise it when code changes what scenes or labels come out of the same files and settings.
LABEL_VERSION = 3

MakeRests = Callable[[TaskObject, Layout], Rests]
MakeLabels = Callable[[TaskObject, PoseTask, np.random.Generator], PoseLabels]


def geometric_labels(subject: TaskObject, task: PoseTask, rng: np.random.Generator) -> PoseLabels:
    """Return the labels of any object: its own poses, and grasps that geometry calls good.

    Raises UnknownTaskError where the object has no poses of the task.
    """
    if task == GRASP:
        return GraspCandidates.from_geometry(subject, rng)
    return FixedPoses(subject.poses_of(task))


@dataclass(frozen=True)
class DatasetRecipe:
    """What a dataset is made of; pickled by worker processes.

    Attributes:
        source: of the objects.
        tasks: whose poses are labelled.
        layout: of the station that the scenes are of.
        make_rests: says how an object comes to rest on the table of a layout.
        make_labels: says which poses of a task are true on an object.
        randomization: what varies from scene to scene.
        scenes_per_object: how many scenes of each.
        seed: of all draws, together with the object's split and number.
        made_from: hashes of what rests and labels come from, by what it is.  Of the two functions
            only the names are recorded: what else they depend on belongs here.
    """

    source: ObjectSource
    tasks: tuple[PoseTask, ...]
    layout: Layout
    make_rests: MakeRests
    make_labels: MakeLabels = geometric_labels
    randomization: DomainRandomization = field(default_factory=DomainRandomization)
    scenes_per_object: int = 150
    seed: int = 0
    made_from: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_numbers(self)

    def config(self) -> dict[str, Any]:
        """Return all that the scenes depend on."""
        return {
            "objects": self.source.sha256(),
            "tasks": [asdict(task) for task in self.tasks],
            "scenes_per_object": self.scenes_per_object,
            "seed": self.seed,
            "randomization": asdict(self.randomization),
            "layout": layout_to_fields(self.layout),
            "make_rests": qualified_name(self.make_rests),
            "make_labels": qualified_name(self.make_labels),
            "made_from": dict(self.made_from),
            "label_version": LABEL_VERSION,
        }


@dataclass(frozen=True)
class GenerateConfig:
    """Which scenes of mugs to generate.

    Attributes:
        out: folder of the dataset.
        mugs: "train", "test", or a folder of meshes whose rests and grasps have been made: by
            `split_drake.data.rests` and `split_drake.grasps.check_grasps`, with the same folder.
        scenes_per_mug: how many scenes of each shape.
        seed: of all draws, together with the mug's number.
        randomization: what varies from scene to scene.
        station: a YAML file of where cameras and table stand, see
            split_drake/station/file/station_file.py; the usual station where not given.
        workers: processes, 1 for this one alone; the scenes do not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
    """

    out: Path
    mugs: str = "train"
    scenes_per_mug: int = 150
    seed: int = 0
    randomization: DomainRandomization = field(default_factory=DomainRandomization)
    station: Path | None = None
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("scenes_per_mug", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")
        MugSource(self.mugs)

    def layout(self) -> Layout:
        """Return where the file has cameras and table, or where they usually stand.

        Says so where the file has more: rests come from drops that were made before, and noise is
        added in training.  Raises BadInputError where the file cannot be used.
        """
        usual = StationConfig(Layout())
        if self.station is None:
            return usual.layout
        asked = read_station(self.station, usual)
        # The usual station of trials steps further.
        if replace(asked, layout=usual.layout, time_step_s=usual.time_step_s) != usual:
            Console(soft_wrap=True).print(
                f"{self.station}: contact settings and depth noise do not change a dataset; rests "
                "are those of split_drake.data.rests, and noise is added in training"
            )
        return asked.layout

    def recipe(self) -> DatasetRecipe:
        """Return what the scenes are made of: mugs with grasps that were tried in physics.

        Raises BadInputError where a file of theirs is missing, or the station's cannot be used.
        """
        layout = self.layout()
        source = usable_mugs(MugSource(self.mugs), self.workers, Console()).source
        made_from = source_hashes(self.mugs)
        if source.left_out:
            made_from["left_out"] = ", ".join(source.left_out)
        return DatasetRecipe(
            source=source,
            tasks=MUG_TASKS,
            layout=layout,
            make_rests=partial(_mug_rests, source, rests_path(self.mugs)),
            make_labels=partial(_mug_labels, source, store_path(self.mugs)),
            randomization=self.randomization,
            scenes_per_object=self.scenes_per_mug,
            seed=self.seed,
            made_from=made_from,
        )


def _mug_rests(source: MugSource, kept: Path, mug: TaskObject, _layout: Layout) -> Rests:
    """Return the rests that are kept, which know their table's top only."""
    return rests_in(kept, source, mug.name)


def _mug_labels(
    source: MugSource, kept: Path, mug: TaskObject, task: PoseTask, rng: np.random.Generator
) -> PoseLabels:
    if task == GRASP:
        return GraspCandidates.from_checked(mug, grasps_in(kept, source, mug.name), rng)
    return FixedPoses(mug.poses_of(task))


def source_hashes(mugs: str) -> dict[str, str]:
    """Return the SHA-256 of each file that the scenes of a split or a folder are made from.

    Raises BadInputError where one is missing.
    """
    paths = {"grasps": store_path(mugs), "rests": rests_path(mugs)}
    commands = {"grasps": "split_drake.grasps.check_grasps", "rests": "split_drake.data.rests"}
    for kind, path in paths.items():
        if not path.is_file():
            raise BadInputError(
                f"{path}, the {kind} of {mugs}, is missing; expected what "
                f"python -m {commands[kind]} --mugs {mugs} writes"
            )
    hashes = {kind: file_sha256(path) for kind, path in paths.items()}
    return {"mugs": MugSource(mugs).mugs_sha256(), **hashes}


def generate_shard(recipe: DatasetRecipe, out: Path, name: str) -> None:
    """Generate the scenes of the object `name` and write them."""
    subject, layout = recipe.source.load(name), recipe.layout
    seeds = np.random.SeedSequence([recipe.seed, *subject.seed])
    # Scenes have a stream of their own, so that other labels leave the poses as they are.
    for_labels, for_scenes = (np.random.default_rng(part) for part in seeds.spawn(2))
    labels = {task.name: recipe.make_labels(subject, task, for_labels) for task in recipe.tasks}
    scenes = ObjectScenes(subject, recipe.make_rests(subject, layout), layout, recipe.randomization)
    generator = SceneGenerator(scenes, labels, layout.workspace, for_scenes)
    write_shard(out / f"{name}.npz", generator.shard(recipe.scenes_per_object))


def summarize(
    folder: Path, names: Sequence[str], tasks: Sequence[PoseTask]
) -> dict[str, float | dict[str, float]]:
    """Return what the scenes of these shards are like, for the manifest."""
    shards = [read_shard(folder / f"{name}.npz", tasks) for name in names]
    points = np.concatenate([shard["feature_points"] for shard in shards])
    views = np.concatenate([shard["views"] for shard in shards])
    return {
        "scenes": len(views),
        "redraws": sum(int(shard["redraws"]) for shard in shards),
        "single_view_share": round(float((views == 1).mean()), 4),
        "hidden_feature_share": round(float((~feature_visible(points)).mean()), 4),
        "median_true_poses": {
            task.name: float(
                np.median(
                    np.concatenate(
                        [(s[f"{task}/states"] == PoseState.TRUE).sum(axis=1) for s in shards]
                    )
                )
            )
            for task in tasks
        },
    }


def generate(recipe: DatasetRecipe, out: Path, workers: int, scheduler: str = LOCAL) -> None:
    """Write the shards that are missing to the folder `out`, then the manifest.

    Raises AnotherRunError where the folder holds scenes of another recipe.
    """
    names = recipe.source.names()
    make = partial(generate_shard, recipe, out)
    with claim_folder(out, recipe.config()) as config:
        missing = [name for name in names if not (out / f"{name}.npz").exists()]
        pool = shard_pool(scheduler, workers, make, out)
        for _ in track(pool.run(missing), "shards", total=len(missing)):
            pass
        write_json(out / MANIFEST, _manifest(recipe, out, config))


def _manifest(recipe: DatasetRecipe, out: Path, config: dict[str, Any]) -> dict[str, Any]:
    names = recipe.source.names()
    shards = {name: file_sha256(out / f"{name}.npz") for name in names}
    return {
        "format_version": FORMAT_VERSION,
        "config": config,
        **summarize(out, names, recipe.tasks),
        "shards": shards,
        "sha256": combined_sha256(shards),
    }


def main(config: GenerateConfig) -> None:
    """Generate the scenes that the command asks for."""
    require_scheduler(config.scheduler)
    generate(config.recipe(), config.out, config.workers, config.scheduler)


if __name__ == "__main__":
    run_command(main, GenerateConfig, __doc__)
