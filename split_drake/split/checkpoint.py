"""Checkpoints: a network's weights with what it takes to rebuild it and to know where it is from.

A checkpoint is a safetensors file whose metadata holds `CheckpointInfo` as JSON, and a checksum of
that and of all tensors: a flipped bit in a weight is a valid weight.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from split_drake.bad_input import BadInputError
from split_drake.files import replacing
from split_drake.models_folder import MODELS_FOLDER
from split_drake.pose_task import MUG_TASKS, PoseTask
from split_drake.scene import Workspace
from split_drake.split.close_up.config import CloseUpConfig
from split_drake.split.diffusion import NoiseSchedule
from split_drake.split.network import SplitNetwork
from split_drake.split.network_config import SplitConfig

FORMAT = "split_drake.split"
FORMAT_VERSION = 1
CHECKSUM = "sha256"
# The metadata that the checksum covers, beside the tensors.
_CHECKED = ("format", "format_version", "info")
DEFAULT_WEIGHTS = "split_mugs.safetensors"
# Of checkpoints that are too old to say theirs, but for edge and depth, which the architecture has.
FIRST_WORKSPACE = Workspace((0.5, 0.0, 0.0), 0.3, 0.05, 0.004)


class CheckpointError(BadInputError):
    """A file is no checkpoint that this version can read."""


@dataclass(frozen=True)
class CheckpointInfo:
    """Where a network comes from.

    Attributes:
        config: architecture and noise schedule.
        tasks: that the network was trained for, in its order.
        workspace: the cube that its scenes were cropped to.
        training: options of the run that made it.
        seed: of that run.
        dataset_hash: of the data it was trained on.
        commit: of the source it was trained by.
        steps, scenes: optimiser steps, and scenes seen in them.
        metrics: what it reached, by name.
        earlier_commits: of the sources that trained it before its run was interrupted and resumed.
        parent: the checkpoint it started from: its sha256, commit, dataset_hash, steps, scenes and
            parent; None where it started from random weights.
    """

    config: SplitConfig
    tasks: tuple[PoseTask, ...]
    workspace: Workspace
    training: dict[str, Any]
    seed: int
    dataset_hash: str
    commit: str
    steps: int
    scenes: int
    metrics: dict[str, Any] = field(default_factory=dict)
    earlier_commits: tuple[str, ...] = ()
    parent: dict[str, Any] | None = None

    @property
    def scenes_in_all(self) -> int:
        """Scenes seen in its own steps and in those of all checkpoints that it comes from."""
        total, ancestor = self.scenes, self.parent
        while ancestor is not None:
            total, ancestor = total + int(ancestor["scenes"]), ancestor["parent"]
        return total


def default_weights() -> Path:
    """Return the path of the checkpoint that ships with the project."""
    return MODELS_FOLDER / "weights" / DEFAULT_WEIGHTS


def save_checkpoint(path: Path, network: SplitNetwork, info: CheckpointInfo) -> None:
    """Write `network` to `path`, atomically.

    Raises ValueError where `info` describes another architecture, or a workspace that is not its
    grid's; CheckpointError where a weight is not finite.
    """
    info.config.require_cube_of(info.workspace)
    if (network.config, network.tasks) != (info.config, info.tasks):
        raise ValueError(
            f"info describes {info.config} for {info.tasks}, the network is {network.config} for "
            f"{network.tasks}"
        )
    metadata = {
        "format": FORMAT,
        "format_version": str(FORMAT_VERSION),
        "info": json.dumps(asdict(info)),
    }
    tensors = {name: value.cpu().contiguous() for name, value in network.state_dict().items()}
    _require_finite(tensors, path)
    metadata[CHECKSUM] = content_sha256(metadata, tensors)
    with replacing(path) as temporary:
        save_file(tensors, temporary, metadata)


def content_sha256(metadata: Mapping[str, str], tensors: Mapping[str, Tensor]) -> str:
    """Return the SHA-256 over what a checkpoint says of itself, and over its tensors.

    That is over their names, types, shapes and bytes, in the order of their names.
    """
    digest = hashlib.sha256()
    for key in _CHECKED:
        digest.update(f"{key}={metadata.get(key)}\0".encode())
    for name in sorted(tensors):
        tensor = tensors[name].contiguous()
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)} ".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def _require_finite(tensors: dict[str, Tensor], path: Path) -> None:
    """Raise CheckpointError naming the tensors that hold NaN or infinite values."""
    if bad := sorted(name for name, value in tensors.items() if not value.isfinite().all()):
        raise CheckpointError(
            f"{path}: {len(bad)} of {len(tensors)} tensors are not finite, {bad[0]} among them"
        )


def _with_tuples(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields that JSON has made lists of as tuples again."""
    return {k: tuple(value) if isinstance(value, list) else value for k, value in fields.items()}


def _parse_info(text: str) -> CheckpointInfo:
    """Return the info written by `save_checkpoint`; anything else raises TypeError or KeyError."""
    values = json.loads(text)
    if not isinstance(values, dict) or not isinstance(values["config"], dict):
        raise TypeError(f"info is {text[:40]}; expected an object with an object 'config'")
    config = values.pop("config")
    noise = NoiseSchedule(**config.pop("noise"))
    if (shown := config.pop("close_up", None)) is not None:
        if not isinstance(shown, dict):
            raise TypeError(f"close_up is {shown}; expected an object")
        config["close_up"] = CloseUpConfig(**_with_tuples(shown))
    values["earlier_commits"] = tuple(values.get("earlier_commits", ()))
    tasks = [PoseTask.from_fields(fields) for fields in values.pop("tasks", ())]
    split_config = SplitConfig(**_with_tuples(config), noise=noise)
    workspace = replace(
        FIRST_WORKSPACE, edge_m=split_config.edge_m, depth_below_m=split_config.table_m
    )
    if (fields := values.pop("workspace", None)) is not None:
        workspace = Workspace.from_fields(fields)
        split_config.require_cube_of(workspace)
    return CheckpointInfo(
        config=split_config, tasks=tuple(tasks) or MUG_TASKS, workspace=workspace, **values
    )


def read_content(path: Path) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Return metadata and tensors of a checkpoint of this format and version, unchecked."""
    if not path.is_file():
        raise CheckpointError(f"{path} does not exist; expected a SPLIT checkpoint (.safetensors)")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise CheckpointError(f"{path} is damaged or no safetensors file: {error}") from error
    if metadata.get("format") != FORMAT:
        raise CheckpointError(
            f"{path} is of format {metadata.get('format')!r}; expected {FORMAT!r}"
        )
    if metadata.get("format_version") != str(FORMAT_VERSION):
        raise CheckpointError(
            f"{path} has format version {metadata.get('format_version')}; "
            f"this code reads version {FORMAT_VERSION}"
        )
    return metadata, tensors


def _require_checksum(path: Path, metadata: dict[str, str], tensors: dict[str, Tensor]) -> None:
    """Raise CheckpointError where the content is not what was written, or where nobody can tell.

    A file without a checksum is refused, not warned of: a warning of a worker process goes unread,
    and one command adds what is missing.
    """
    expected = metadata.get(CHECKSUM)
    if expected is None:
        raise CheckpointError(
            f"{path} has no checksum, so that damage could not be told; where you trust the file, "
            f"python -m split_drake.split.stamp {path} adds one"
        )
    if (found := content_sha256(metadata, tensors)) != expected:
        raise CheckpointError(
            f"{path} is damaged: its content has the SHA-256 {found[:12]}, expected {expected[:12]}"
        )


def load_checkpoint(path: Path) -> tuple[SplitNetwork, CheckpointInfo]:
    """Return the network, ready for inference on the CPU, and its provenance.

    Raises CheckpointError where the file is missing, damaged, without a checksum, of another
    program or version, where its weights don't fit the architecture it describes, or where they are
    not finite.
    """
    metadata, tensors = read_content(path)
    _require_checksum(path, metadata, tensors)
    return rebuilt(path, metadata, tensors)


def rebuilt(
    path: Path, metadata: dict[str, str], tensors: dict[str, Tensor]
) -> tuple[SplitNetwork, CheckpointInfo]:
    """Return the network, ready for inference on the CPU, and its provenance, of what was read.

    Raises CheckpointError where the weights don't fit the architecture, or are not finite.
    """
    try:
        info = _parse_info(metadata["info"])
        network = SplitNetwork(info.config, info.tasks)
        network.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(f"{path} does not describe the network it holds: {error}") from error
    _require_finite(tensors, path)
    return network.eval(), info
