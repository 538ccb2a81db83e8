"""Labelled scenes on disk: shards, and a manifest with their checksums.

A dataset is a folder with ``manifest.json``, which says what it was made from, its tasks and its
layout, and shards ``<name>.npz``, each holding S scenes of M subjects, and L labelled poses of
every task on each subject.  A subject is one object, with a shard of its own; or all that lies in a
scene of clutter, at X_WO = I, with a single scene of it:

==================  ===============  =======  =================================================
array               shape            type     content
==================  ===============  =======  =================================================
points              (S, 2000, 3)     uint16   sampled points without noise: cells of the
                                              workspace's cube divided 65536 times along each edge
X_WOs               (S, 4, 4)        float32  pose of the subject
subjects            (S,)             int32    which of the shard's subjects each scene shows
p_WCs               (S, 3)           float32  where the (first) camera stands
feature_points      (S,)             int32    how many of the points lie on the part that poses
                                              are told by, a mug's handle say; -1 without one
views               (S,)             uint8    number of cameras
redraws             ()               int32    scenes drawn again for want of true poses
<task>/X_OPs        (M, L, 4, 4)     float32  poses in the subject's frame
<task>/weights      (M, L)           float32  weight of a pose where it is true, 0 if nowhere
<task>/states       (S, L)           uint8    `PoseState` of each pose in each scene
==================  ===============  =======  =================================================

13 kB a scene, and no more when compressed: the points fill their cells at random.
"""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from split_drake.bad_input import BadInputError
from split_drake.experiments.provenance import file_sha256
from split_drake.files import interpreting, read_json_object, read_npz, replacing
from split_drake.pose_task import PoseTask
from split_drake.poses import Array
from split_drake.scene import Workspace
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_from_fields

FORMAT_VERSION = 3
MANIFEST = "manifest.json"
SCENE_ARRAYS = ("points", "X_WOs", "subjects", "p_WCs", "feature_points", "views", "redraws")
LABEL_ARRAYS = ("X_OPs", "weights", "states")
CELLS = 65536

Shard = dict[str, np.ndarray]


class DatasetError(BadInputError):
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
class TaskLabels:
    """The labelled poses of one task on M subjects, in S scenes; L of each subject at most.

    Attributes:
        X_OPs: (M, L, 4, 4) poses; subjects with fewer are padded by the identity.
        weights: (M, L) weight in (0, 1] of poses that can be true, 0 for others.
        states: (S, L) `PoseState` of each of its subject's poses.
    """

    X_OPs: NDArray[np.float32]
    weights: NDArray[np.float32]
    states: NDArray[np.uint8]

    @classmethod
    def of_shards(cls, shards: Sequence[Shard], task: PoseTask) -> Self:
        """Return the labels that some shards hold of a task."""
        count = max(shard[f"{task}/X_OPs"].shape[1] for shard in shards)

        def joined(array: str) -> np.ndarray:
            return np.concatenate([_padded(shard[f"{task}/{array}"], count) for shard in shards])

        X_OPs, weights, states = (joined(array) for array in LABEL_ARRAYS)
        X_OPs[~X_OPs[..., 3, 3].astype(bool)] = np.eye(4)
        return cls(X_OPs, weights, states)


@dataclass(frozen=True)
class SceneDataset:
    """A dataset in memory: S scenes of M subjects.

    Attributes:
        clouds: (S, 2000, 3) sampled points without noise, metres in W.
        X_WOs: (S, 4, 4) pose of the subject.
        p_WCs: (S, 3) where the (first) camera stands.
        feature_points: (S,) how many of the points lie on the object's feature.
        views: (S,) number of cameras.
        object_index: (S,) which subject each scene shows.
        shard_names: of the shards.
        tasks: whose poses are labelled.
        labels: {name of a task: its labels}.
        layout: of the station that the scenes are of.
        config: that the scenes were generated with.
        dataset_hash: SHA-256 over the shards.
    """

    clouds: NDArray[np.float32]
    X_WOs: NDArray[np.float32]
    p_WCs: NDArray[np.float32]
    feature_points: NDArray[np.int32]
    views: NDArray[np.uint8]
    object_index: NDArray[np.int_]
    shard_names: tuple[str, ...]
    tasks: tuple[PoseTask, ...]
    labels: Mapping[str, TaskLabels]
    layout: Layout
    config: dict[str, Any]
    dataset_hash: str

    def __len__(self) -> int:
        return len(self.object_index)

    @property
    def workspace(self) -> Workspace:
        """The cube that the scenes were cropped to."""
        return self.layout.workspace

    @classmethod
    def open(cls, folder: Path, verify: bool = True) -> Self:
        """Read a folder, several shards at a time.

        Raises DatasetError where the manifest is missing, of another format, or, with `verify`,
        where a shard is missing or has changed.
        """
        manifest = read_manifest(folder)
        with interpreting(folder / MANIFEST, "the manifest of a dataset"):
            hashes = {str(name): str(sha256) for name, sha256 in manifest["shards"].items()}
            tasks = tuple(PoseTask.from_fields(fields) for fields in manifest["config"]["tasks"])
            layout = layout_from_fields(manifest["config"]["layout"])
            dataset_hash = str(manifest["sha256"])
        names = tuple(sorted(hashes))
        read = partial(_read_listed, folder, hashes, tasks, verify)
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as executor:
            shards = list(executor.map(read, names))

        def joined(key: str) -> np.ndarray:
            return np.concatenate([shard[key] for shard in shards])

        return cls(
            clouds=_decode_all([shard.pop("points") for shard in shards], layout.workspace),
            X_WOs=joined("X_WOs"),
            feature_points=joined("feature_points"),
            views=joined("views"),
            p_WCs=joined("p_WCs"),
            object_index=_subjects(shards, tasks[0]),
            shard_names=names,
            tasks=tasks,
            labels={task.name: TaskLabels.of_shards(shards, task) for task in tasks},
            layout=layout,
            config=manifest["config"],
            dataset_hash=dataset_hash,
        )


def _decode_all(cells: list[NDArray[np.uint16]], workspace: Workspace) -> NDArray[np.float32]:
    """Return the points of all shards one after another, without a second copy of them."""
    clouds = np.empty((sum(map(len, cells)), *cells[0].shape[1:]), dtype=np.float32)
    start = 0
    for part in cells:
        clouds[start : start + len(part)] = decode_points(part, workspace)
        start += len(part)
    return clouds


def _subjects(shards: Sequence[Shard], task: PoseTask) -> NDArray[np.int_]:
    """Return (S,) which subject of all shards each scene shows."""
    counts = [len(shard[f"{task}/X_OPs"]) for shard in shards]
    firsts = np.cumsum([0, *counts[:-1]])
    return np.concatenate(
        [first + shard["subjects"] for first, shard in zip(firsts, shards, strict=True)]
    ).astype(int)


def _padded(array: np.ndarray, count: int) -> np.ndarray:
    """Return the array with zeros (`PoseState.PADDING`) up to `count` along its second axis."""
    widths = [(0, 0)] * array.ndim
    widths[1] = (0, count - array.shape[1])
    return np.pad(array, widths)


def write_shard(path: Path, shard: Shard) -> None:
    """Write a shard at once or not at all."""
    with replacing(path) as temporary:
        np.savez(temporary, allow_pickle=False, **shard)


def read_shard(path: Path, tasks: Sequence[PoseTask]) -> Shard:
    """Return the arrays of a shard with these tasks."""
    keys = [f"{task}/{array}" for task in tasks for array in LABEL_ARRAYS]
    wanted = (*SCENE_ARRAYS, *keys)
    arrays = read_npz(path, "a shard of a dataset with these tasks", required=wanted)
    return {key: arrays[key] for key in wanted}


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the content of a dataset's manifest; raise DatasetError where there is none."""
    path = folder / MANIFEST
    if not path.is_file():
        raise DatasetError(f"{folder} has no {MANIFEST}: no dataset, or an unfinished one")
    manifest = read_json_object(path, "the manifest of a dataset")
    version = manifest.get("format_version")
    if version != FORMAT_VERSION:
        raise DatasetError(f"{path} is of format {version!r}; expected {FORMAT_VERSION}")
    return manifest


def _read_listed(
    folder: Path, hashes: dict[str, str], tasks: Sequence[PoseTask], verify: bool, name: str
) -> Shard:
    """Return a shard of a manifest's, its hash compared with the one there."""
    path = folder / f"{name}.npz"
    if not path.is_file():
        raise DatasetError(f"{path} is missing")
    if verify and (found := file_sha256(path)) != hashes[name]:
        raise DatasetError(
            f"{path} has changed: SHA-256 {found[:12]}, expected {hashes[name][:12]}"
        )
    return read_shard(path, tasks)
