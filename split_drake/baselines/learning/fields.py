"""Fields on disk: a shard for each of a dataset's, and all of them in memory.

==========  ======================  =======  ======================================================
array       shape                   type     content
==========  ======================  =======  ======================================================
fields      (S, V, 40, 40, 40)      uint8    a TSDF in 255ths, for each noise of the depth image
p_VPs       (P, 3)                  float32  points, the same for all scenes of the shard
occupied    (S, P / 8)              uint8    whether they lie within an object, eight to a byte
widths_m    (S, T)                  float32  of what the true grasps pinch, in the dataset's order
==========  ======================  =======  ======================================================
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from split_drake.baselines.tsdf import RESOLUTION
from split_drake.data.dataset import DatasetError
from split_drake.experiments.run import CONFIG
from split_drake.files import read_json_object, read_npz, replacing

OCCUPANCY_POINTS = 16384
_WHAT = "fields of a dataset's shard"


@dataclass(frozen=True)
class FieldShard:
    """The arrays of a shard, see above."""

    fields: NDArray[np.uint8]
    p_VPs: NDArray[np.float32]
    occupied: NDArray[np.uint8]
    widths_m: NDArray[np.float32]


def field_file(folder: Path, shard: str) -> Path:
    """Return the file of the fields of a dataset's shard."""
    return folder / f"{shard}.npz"


def write_fields(path: Path, shard: FieldShard) -> None:
    """Write a shard at once or not at all; most of a field is 0, so that it is compressed well."""
    arrays = {entry.name: getattr(shard, entry.name) for entry in fields(FieldShard)}
    with replacing(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)


@dataclass(frozen=True)
class SceneFields:
    """The fields of all scenes of a dataset, in its order.

    Attributes:
        fields: (S, V, r, r, r) in 255ths.
        p_VPs: (K, P, 3) points of each of K shards.
        shard_index: (S,) whose points are those of a scene.
        occupied: (S, P / 8) eight points to a byte.
        widths_m: (S, T) of what the true grasps pinch.
    """

    fields: NDArray[np.uint8]
    p_VPs: NDArray[np.float32]
    shard_index: NDArray[np.int_]
    occupied: NDArray[np.uint8]
    widths_m: NDArray[np.float32]

    @classmethod
    def open(cls, folder: Path, shard_names: tuple[str, ...], dataset_hash: str) -> Self:
        """Read the fields of a dataset's shards.

        Raises DatasetError where they are of another dataset, or some are missing.
        """
        if not (folder / CONFIG).is_file():
            raise DatasetError(
                f"{folder} has no {CONFIG}; expected a folder of "
                "split_drake.baselines.learning.draw_fields"
            )
        found = read_json_object(folder / CONFIG, "the options of fields").get("dataset_hash")
        if found != dataset_hash:
            raise DatasetError(
                f"{folder} holds the fields of dataset {str(found)[:12]}; "
                f"expected those of {dataset_hash[:12]}"
            )
        shards = [_read(field_file(folder, name)) for name in shard_names]
        counts = [len(shard.fields) for shard in shards]
        whole = np.empty((sum(counts), *shards[0].fields.shape[1:]), np.uint8)
        for shard, start in zip(shards, np.cumsum([0, *counts]), strict=False):
            whole[start : start + len(shard.fields)] = shard.fields
        return cls(
            whole,
            np.stack([shard.p_VPs for shard in shards]),
            np.repeat(np.arange(len(shards)), counts),
            np.concatenate([shard.occupied for shard in shards]),
            np.concatenate([shard.widths_m for shard in shards]),
        )


def _read(path: Path) -> FieldShard:
    names = [entry.name for entry in fields(FieldShard)]
    arrays = read_npz(path, _WHAT, names)
    if arrays["fields"].shape[2:] != (RESOLUTION,) * 3:
        raise DatasetError(
            f"{path} holds fields of shape {arrays['fields'].shape}; "
            f"expected (S, V, {RESOLUTION}, {RESOLUTION}, {RESOLUTION})"
        )
    return FieldShard(**{name: arrays[name] for name in names})
