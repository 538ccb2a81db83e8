"""Mug scenes on disk: one shard a mug, and a manifest with their checksums.

A dataset is a folder with ``manifest.json`` and one ``<mug>.npz`` a shape, each holding S scenes
and the L grasp candidates of its mug:

=================  ===============  =======  ==================================================
array              shape            type     content
=================  ===============  =======  ==================================================
points             (S, 2000, 3)     uint16   sampled points without noise: cells of the
                                             workspace's cube divided 65536 times along each edge
X_WOs              (S, 4, 4)        float32  pose of the mug
grasp_states       (S, L)           uint8    `GraspState` of each candidate in each scene
handle_points      (S,)             int32    how many of the points lie on the handle
views              (S,)             uint8    number of cameras
X_OGs              (L, 4, 4)        float32  grasp candidates
qualities          (L,)             float32  weight of a candidate where it is true, 0 if nowhere
X_OHs              (2, 4, 4)        float32  the two equivalent handle poses
redraws            ()               int32    scenes drawn again for want of true grasps
=================  ===============  =======  ==================================================

13 kB a scene, and no more when compressed: the points fill their cells at random.
"""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from split_drake.experiments.provenance import file_sha256
from split_drake.files import replacing
from split_drake.poses import Array
from split_drake.scene import Workspace

FORMAT_VERSION = 2
MANIFEST = "manifest.json"
SHARD_ARRAYS = (
    "points",
    "X_WOs",
    "grasp_states",
    "handle_points",
    "views",
    "X_OGs",
    "qualities",
    "X_OHs",
    "redraws",
)
CELLS = 65536

Shard = dict[str, np.ndarray]


class DatasetError(ValueError):
    """A folder holds no dataset, or a damaged one."""


def encode_points(p_WPs: Array, workspace: Workspace) -> NDArray[np.uint16]:
    """Return the cells (..., 3) of the workspace's cube that points (..., 3) lie in.

    Raises ValueError where a point lies outside.
    """
    cells = np.floor((p_WPs - workspace.p_WV) / workspace.edge_m * CELLS)
    if cells.min() < 0 or cells.max() >= CELLS:
        raise ValueError(f"points reach outside the workspace of {workspace.edge_m} m")
    return cells.astype(np.uint16)


def decode_points(cells: NDArray[np.uint16], workspace: Workspace) -> NDArray[np.float32]:
    """Return the centres (..., 3) of cells (..., 3), metres in W."""
    cell_m = np.float32(workspace.edge_m / CELLS)
    first = workspace.p_WV.astype(np.float32) + cell_m / 2
    return np.asarray(cells * cell_m + first, dtype=np.float32)


@dataclass(frozen=True)
class MugDataset:
    """A dataset in memory: S scenes of M mugs, with L grasp candidates a mug.

    Attributes:
        clouds: (S, 2000, 3) sampled points without noise, metres in W.
        X_WOs: (S, 4, 4) pose of the mug.
        grasp_states: (S, L) `GraspState` of each of its mug's candidates.
        handle_points: (S,) how many of the points lie on the handle.
        views: (S,) number of cameras.
        mug_index: (S,) which mug each scene shows.
        mug_names: of the M mugs.
        X_OGs: (M, L, 4, 4) grasp candidates; mugs with fewer are padded by the identity.
        qualities: (M, L) weight in (0, 1] of candidates that can be true, 0 for others.
        X_OHs: (M, 2, 4, 4) the two equivalent handle poses.
        config: that the scenes were generated with.
        dataset_hash: SHA-256 over the shards.
    """

    clouds: NDArray[np.float32]
    X_WOs: NDArray[np.float32]
    grasp_states: NDArray[np.uint8]
    handle_points: NDArray[np.int32]
    views: NDArray[np.uint8]
    mug_index: NDArray[np.int_]
    mug_names: tuple[str, ...]
    X_OGs: NDArray[np.float32]
    qualities: NDArray[np.float32]
    X_OHs: NDArray[np.float32]
    config: dict[str, Any]
    dataset_hash: str

    def __len__(self) -> int:
        return len(self.mug_index)

    @property
    def handles(self) -> NDArray[np.float32]:
        """(S, 2, 4, 4): the two equivalent handle poses X_WH."""
        return self.X_WOs[:, None] @ self.X_OHs[self.mug_index]

    @property
    def uprights(self) -> NDArray[np.float32]:
        """(S, 1, 4, 4): the upright pose X_WU."""
        return self.X_WOs[:, None]

    @classmethod
    def open(cls, folder: Path, verify: bool = True) -> "MugDataset":
        """Read a folder, several shards at a time.

        Raises DatasetError where the manifest is missing, of another format, or, with `verify`,
        where a shard is missing or has changed.
        """
        manifest = read_manifest(folder)
        names = tuple(sorted(manifest["shards"]))
        read = partial(_read_listed, folder, manifest["shards"], verify)
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as executor:
            shards = list(executor.map(read, names))
        described = manifest["config"]["workspace"]
        workspace = Workspace(**described | {"p_WCenter": tuple(described["p_WCenter"])})
        count = max(len(shard["X_OGs"]) for shard in shards)

        def joined(key: str) -> np.ndarray:
            return np.concatenate([shard[key] for shard in shards])

        return cls(
            clouds=_decode_all([shard.pop("points") for shard in shards], workspace),
            X_WOs=joined("X_WOs"),
            grasp_states=np.concatenate([_padded(s["grasp_states"], count, 1) for s in shards]),
            handle_points=joined("handle_points"),
            views=joined("views"),
            mug_index=np.repeat(np.arange(len(names)), [len(shard["X_WOs"]) for shard in shards]),
            mug_names=names,
            X_OGs=np.stack([_padded_poses(shard["X_OGs"], count) for shard in shards]),
            qualities=np.stack([_padded(shard["qualities"], count, 0) for shard in shards]),
            X_OHs=np.stack([shard["X_OHs"] for shard in shards]),
            config=manifest["config"],
            dataset_hash=manifest["sha256"],
        )


def _decode_all(cells: list[NDArray[np.uint16]], workspace: Workspace) -> NDArray[np.float32]:
    """Return the points of all shards one after another, without a second copy of them."""
    clouds = np.empty((sum(map(len, cells)), *cells[0].shape[1:]), dtype=np.float32)
    start = 0
    for part in cells:
        clouds[start : start + len(part)] = decode_points(part, workspace)
        start += len(part)
    return clouds


def _padded(array: np.ndarray, count: int, axis: int) -> np.ndarray:
    """Return the array with zeros (`GraspState.PADDING`) up to `count` along `axis`."""
    widths = [(0, 0)] * array.ndim
    widths[axis] = (0, count - array.shape[axis])
    return np.pad(array, widths)


def _padded_poses(X: np.ndarray, count: int) -> np.ndarray:
    """Return poses (N, 4, 4) with the identity up to `count` of them."""
    return np.concatenate([X, np.tile(np.eye(4, dtype=X.dtype), (count - len(X), 1, 1))])


def write_shard(path: Path, shard: Shard) -> None:
    """Write a shard at once or not at all; `shard` holds all of `SHARD_ARRAYS`."""
    with replacing(path) as temporary:
        np.savez(temporary, allow_pickle=False, **{key: shard[key] for key in SHARD_ARRAYS})


def read_shard(path: Path) -> Shard:
    """Return the arrays of a shard."""
    with np.load(path, allow_pickle=False) as archive:
        return {key: archive[key] for key in SHARD_ARRAYS}


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


def _read_listed(folder: Path, hashes: dict[str, str], verify: bool, name: str) -> Shard:
    """Return a shard of a manifest's, its hash compared with the one there."""
    path = folder / f"{name}.npz"
    if not path.is_file():
        raise DatasetError(f"{path} is missing")
    if verify and (found := file_sha256(path)) != hashes[name]:
        raise DatasetError(
            f"{path} has changed: SHA-256 {found[:12]}, expected {hashes[name][:12]}"
        )
    return read_shard(path)
