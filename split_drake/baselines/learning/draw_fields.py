"""Draw what VGN and GIGA learn from, beside a dataset of clutter, once for both.

``python -m split_drake.baselines.learning.draw_fields --data DIR --library FILE --out DIR``

The dataset's scenes are drawn again from its seed, and have to come out the same.  A shard that is
there is kept, so that an interrupted run goes on.
"""

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from rich.progress import track

from split_drake.bad_input import require_count
from split_drake.baselines.learning.fields import (
    OCCUPANCY_POINTS,
    FieldShard,
    field_file,
    write_fields,
)
from split_drake.baselines.learning.scene_fields import SceneSolid, noisy_fields
from split_drake.data.clutter.generate import shard_of
from split_drake.data.clutter.labels import TRUE_KEPT
from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScenes
from split_drake.data.clutter.sizes import clutter_source
from split_drake.data.clutter.views import ViewRandomization
from split_drake.data.dataset import DatasetError, read_manifest, read_shard
from split_drake.experiments.command import run_command
from split_drake.experiments.pool import InThisProcess, WorkerPool
from split_drake.experiments.run import as_json, claim_folder, require_same
from split_drake.pose_task import GRASP
from split_drake.station.layout_file import layout_from_fields

# Fields are drawn from a stream of their own, so that the scenes come out the same.
_STREAM = 1


def draw_shard(recipe: ClutterRecipe, data: Path, out: Path, name: str) -> None:
    """Draw the scenes of a dataset's shard again, and write their fields.

    Raises DatasetError where other scenes come of it.
    """
    kept = read_shard(data / f"{name}.npz", (GRASP,))
    seed = [recipe.seed, int(name.rpartition("_")[2])]
    scenes = ClutterScenes(recipe, np.random.default_rng(seed)).draw_all()
    drawn = [next(scenes) for _ in range(len(kept["points"]))]
    if not np.array_equal(shard_of(drawn)["points"], kept["points"]):
        raise DatasetError(
            f"{data / name} has other scenes than are drawn of its seed now; "
            "draw fields on the kind of machine, and by the code, that the dataset was made with"
        )
    rng = np.random.default_rng([*seed, _STREAM])
    workspace = recipe.layout.workspace
    p_VPs = rng.uniform(0.0, workspace.edge_m, (OCCUPANCY_POINTS, 3)).astype(np.float32)
    widths = np.zeros((len(drawn), TRUE_KEPT), np.float32)
    inside = np.zeros((len(drawn), OCCUPANCY_POINTS), bool)
    for index, each in enumerate(drawn):
        solid = SceneSolid(each)
        widths[index, : len(each.grasps.X_WGs)] = solid.widths(each.grasps.X_WGs)
        inside[index] = solid.holds(p_VPs + workspace.p_WV)
    write_fields(
        field_file(out, name),
        FieldShard(
            fields=np.stack([noisy_fields(each, rng) for each in drawn]),
            p_VPs=p_VPs,
            occupied=np.packbits(inside, axis=1),
            widths_m=widths,
        ),
    )


@dataclass(frozen=True)
class FieldOptions:
    """What to draw fields of.

    Attributes:
        data: dataset of `split_drake.data.clutter.generate`.
        library: file of grasps that it was made with.
        out: folder of the fields.
        objects: split of the procedural objects that it was made with.
        workers: processes, 1 for this one alone; the fields do not depend on them.
    """

    data: Path
    library: Path
    out: Path
    objects: Literal["train", "test"] = "train"
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_count("workers", self.workers, 1)


def recipe_of(options: FieldOptions) -> ClutterRecipe:
    """Return the recipe of the dataset; AnotherRunError names what is not as it was made."""
    config = read_manifest(options.data)["config"]
    recipe = ClutterRecipe(
        clutter_source(options.objects),
        options.library,
        layout_from_fields(config["layout"]),
        ViewRandomization(),
        int(config["seed"]),
    )
    require_same(options.data, config, as_json(recipe.config()))
    return recipe


def main(options: FieldOptions) -> None:
    """Draw the fields that are missing."""
    recipe = recipe_of(options)
    manifest = read_manifest(options.data)
    with claim_folder(options.out, {"dataset_hash": manifest["sha256"]}):
        missing = [
            name for name in manifest["shards"] if not field_file(options.out, name).exists()
        ]
        draw = partial(draw_shard, recipe, options.data, options.out)
        pool = InThisProcess(draw) if options.workers == 1 else WorkerPool(draw, options.workers)
        for _ in track(pool.run(missing), "shards", total=len(missing)):
            pass


if __name__ == "__main__":
    run_command(main, FieldOptions, __doc__)
