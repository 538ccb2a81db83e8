"""Mug scenes on disk: one shard a mug, and a manifest with their checksums.

A dataset is a folder with ``manifest.json`` and one ``<mug>.npz`` a shape, each holding S scenes:

=================  ===============  ===========================================================
array              shape            content
=================  ===============  ===========================================================
clouds             (S, 2000, 3)     sampled points without noise, metres in W
X_WOs              (S, 4, 4)        pose of the mug
grasps             (S, 128, 4, 4)   feasible grasps X_WG, drawn in proportion to their quality
grasp_negatives    (S, 64, 4, 4)    infeasible or false grasps X_WG
handles            (S, 2, 4, 4)     the two equivalent handle poses X_WH
uprights           (S, 1, 4, 4)     upright pose X_WU
handle_points      (S,)             how many of the points lie on the handle
=================  ===============  ===========================================================

All arrays are float32 but `handle_points`, int32.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FORMAT_VERSION = 1
MANIFEST = "manifest.json"
ARRAYS = (
    "clouds",
    "X_WOs",
    "grasps",
    "grasp_negatives",
    "handles",
    "uprights",
    "handle_points",
)


class DatasetError(ValueError):
    """A folder holds no dataset, or a damaged one."""


def file_sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def combined_sha256(shard_hashes: dict[str, str]) -> str:
    """Return the hash of a dataset, given that of each shard."""
    text = json.dumps(shard_hashes, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class MugDataset:
    """A dataset in memory, the scenes of all shards one after another.

    Attributes:
        clouds, X_WOs, grasps, grasp_negatives, handles, uprights, handle_points: see the module.
        mug_names: of the shards.
        mug_index: (S,) which shard each scene comes from.
        config: that the scenes were generated with.
        dataset_hash: SHA-256 over the shards.
    """

    clouds: NDArray[np.float32]
    X_WOs: NDArray[np.float32]
    grasps: NDArray[np.float32]
    grasp_negatives: NDArray[np.float32]
    handles: NDArray[np.float32]
    uprights: NDArray[np.float32]
    handle_points: NDArray[np.int32]
    mug_names: tuple[str, ...]
    mug_index: NDArray[np.int_]
    config: dict[str, Any]
    dataset_hash: str

    def __len__(self) -> int:
        return len(self.mug_index)

    @classmethod
    def open(cls, folder: Path, verify: bool = True) -> "MugDataset":
        """Read a folder.

        Raises DatasetError where the manifest is missing, of another format, or, with `verify`,
        where a shard is missing or has changed.
        """
        manifest = read_manifest(folder)
        names = tuple(sorted(manifest["shards"]))
        shards = [_read_shard(folder, name, manifest["shards"][name], verify) for name in names]
        counts = [len(shard["clouds"]) for shard in shards]
        arrays = {key: np.concatenate([shard[key] for shard in shards]) for key in ARRAYS}
        index = np.repeat(np.arange(len(names)), counts)
        return cls(
            **arrays,
            mug_names=names,
            mug_index=index,
            config=manifest["config"],
            dataset_hash=manifest["sha256"],
        )


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the content of a dataset's manifest; raise DatasetError where there is none."""
    path = folder / MANIFEST
    if not path.is_file():
        raise DatasetError(f"{folder} has no {MANIFEST}: no dataset, or an unfinished one")
    manifest = json.loads(path.read_text())
    version = manifest.get("format_version")
    if version != FORMAT_VERSION:
        raise DatasetError(f"{path} is of format {version!r}; expected {FORMAT_VERSION}")
    return dict(manifest)


def _read_shard(folder: Path, name: str, expected: str, verify: bool) -> dict[str, np.ndarray]:
    path = folder / f"{name}.npz"
    if not path.is_file():
        raise DatasetError(f"{path} is missing")
    if verify and (found := file_sha256(path)) != expected:
        raise DatasetError(f"{path} has changed: SHA-256 {found[:12]}, expected {expected[:12]}")
    with np.load(path, allow_pickle=False) as archive:
        return {key: archive[key] for key in ARRAYS}
