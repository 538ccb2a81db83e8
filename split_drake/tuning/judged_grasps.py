"""Grasps that a model drew itself, and which of them hold: what its evaluator should say of them.

A folder holds ``config.json``, which names the shards, and one ``<shard>.npz`` each, with S scenes
of K grasps:

========  ===============  =======  ==========================================
array     shape            type     content
========  ===============  =======  ==========================================
clouds    (S, 2000, 3)     float32  sampled points without noise, metres in W
sampled   (S, K, 4, 4)     float32  grasps X_WG
held      (S, K)           bool     whether each holds
========  ===============  =======  ==========================================

A shard depends on the seed and its name alone; shards that exist are kept.  `judged_mugs` and
`judged_clutter` make them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track

from split_drake.bad_input import BadInputError
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.run import CONFIG, claim_folder
from split_drake.files import interpreting, read_json_object, read_npz, replacing
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.training.augmentation import AugmentationConfig

Shard = dict[str, np.ndarray]
_ARRAYS = ("clouds", "sampled", "held")


class JudgedGraspsError(BadInputError):
    """A folder holds not all of the judged grasps."""


def with_training_noise(scene: Scene, rng: np.random.Generator) -> Scene:
    """Return a scene whose points are as noisy as any that the model is trained on."""
    return scene.with_noise(rng.uniform(*AugmentationConfig().noise_m), rng)


def judged_scene(scene: Scene, X_WGs: Array, held: NDArray[np.bool_]) -> Shard:
    """Return the arrays of a scene without noise, with grasps (K, 4, 4), of which some hold."""
    return {
        "clouds": scene.p_WSs.astype(np.float32),
        "sampled": X_WGs.astype(np.float32),
        "held": held,
    }


def write_scenes(path: Path, scenes: Sequence[Shard]) -> None:
    """Write scenes with as many grasps each as a shard, at once or not at all."""
    arrays = {key: np.stack([scene[key] for scene in scenes]) for key in scenes[0]}
    with replacing(path) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def write_missing(
    out: Path,
    record: dict[str, Any],
    names: Sequence[str],
    write: Callable[[str], None],
    workers: int,
) -> None:
    """Have those shards written that are missing in `out`, each by `write` in a worker process.

    Args:
        record: all that the shards depend on, "workspace" among it.

    Raises AnotherRunError where the folder holds shards of another record.
    """
    with claim_folder(out, record | {"shards": list(names)}):
        missing = [name for name in names if not (out / f"{name}.npz").exists()]
        pool = WorkerPool(write, workers, start_worker=partial(torch.set_num_threads, 1))
        for _ in track(pool.run(missing), "shards", total=len(missing)):
            pass


@dataclass(frozen=True)
class JudgedGrasps:
    """Judged grasps in memory, the S scenes of all shards one after another.

    Attributes:
        clouds, sampled, held: see the module.
        shard_index: (S,) which shard each scene comes from.
        shards: how many there are.
        workspace: that the scenes were cropped to.
    """

    clouds: NDArray[np.float32]
    sampled: NDArray[np.float32]
    held: NDArray[np.bool_]
    shard_index: NDArray[np.int_]
    shards: int
    workspace: Workspace

    @classmethod
    def open(cls, folder: Path) -> Self:
        """Read all shards of a folder; raise JudgedGraspsError where some are missing."""
        config = _read_config(folder)
        names = config["shards"]
        paths = [folder / f"{name}.npz" for name in names]
        if missing := [path for path in paths if not path.is_file()]:
            raise JudgedGraspsError(
                f"{len(missing)} of {len(paths)} shards are missing, {missing[0]} the first; "
                "judge them first"
            )
        shards = []
        for path in paths:
            arrays = read_npz(path, "a shard of judged grasps", required=_ARRAYS)
            shards.append({key: arrays[key] for key in _ARRAYS})
        with interpreting(folder, "a folder of judged grasps"):
            arrays = {key: np.concatenate([shard[key] for shard in shards]) for key in _ARRAYS}
            index = np.repeat(np.arange(len(names)), [len(shard["held"]) for shard in shards])
            workspace = Workspace.from_fields(config["workspace"])
        return cls(**arrays, shard_index=index, shards=len(names), workspace=workspace)


def _read_config(folder: Path) -> dict[str, Any]:
    """Return what the folder's grasps were judged with; JudgedGraspsError where it does not say."""
    path = folder / CONFIG
    config = read_json_object(path, "what grasps were judged with") if path.is_file() else {}
    for name, what in (("workspace", "of which workspace"), ("shards", "in which shards")):
        if name not in config:
            raise JudgedGraspsError(f"{path} does not say {what} the judged grasps are")
    return config
