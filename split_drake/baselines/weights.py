"""Weights of the baselines that were trained here: safetensors that say whose they are."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from split_drake.bad_input import BadInputError
from split_drake.baselines.published import fitted, load_published
from split_drake.files import interpreting, replacing
from split_drake.split.checkpoint import CHECKSUM, content_sha256

FORMAT = "split_drake.baseline"
FORMAT_VERSION = 1
Network = TypeVar("Network", bound=nn.Module)


class BaselineWeightsError(BadInputError):
    """A file does not hold the weights of the method that they are wanted for."""


@dataclass(frozen=True)
class BaselineInfo:
    """Where a baseline's weights come from.

    Attributes:
        method: whose weights these are.
        dataset_hash: of the data it was trained on.
        commit: of the source it was trained by.
        seed: of the run.
        epochs: over the scenes, those of the weights kept.
        scenes: seen in them.
        minutes: of the whole run.
        validation_loss: on scenes that it was not trained on, by which the epoch was chosen.
    """

    method: str
    dataset_hash: str
    commit: str
    seed: int
    epochs: float
    scenes: int
    minutes: float
    validation_loss: float


def save_weights(path: Path, state: Mapping[str, Tensor], info: BaselineInfo) -> None:
    """Write a network's state dictionary, atomically."""
    metadata = {
        "format": FORMAT,
        "format_version": str(FORMAT_VERSION),
        "info": json.dumps(asdict(info)),
    }
    tensors = {name: value.cpu().contiguous() for name, value in state.items()}
    metadata[CHECKSUM] = content_sha256(metadata, tensors)
    with replacing(path) as temporary:
        save_file(tensors, temporary, metadata)


def load_weights(network: Network, method: str, path: Path) -> Network:
    """Return a network with the weights of a file: trained here, or published by its authors.

    A `.safetensors` file has to be one of `save_weights`, of that method; anything else has to be
    a PyTorch state dictionary.

    Raises BaselineWeightsError, or PublishedWeightsError, where it is something else, or damaged.
    """
    if path.suffix != ".safetensors":
        return load_published(network, path)
    tensors, info = read_weights(path)
    if info.method != method:
        raise BaselineWeightsError(f"{path} holds weights of {info.method}; expected {method}'s")
    return fitted(network, path, tensors)


def read_weights(path: Path) -> tuple[dict[str, Tensor], BaselineInfo]:
    """Return tensors and provenance of a file of `save_weights`.

    Raises BaselineWeightsError where it is none, or damaged.
    """
    metadata, tensors = _content(path)
    if metadata.get("format") != FORMAT or metadata.get("format_version") != str(FORMAT_VERSION):
        found = metadata.get("format"), metadata.get("format_version")
        raise BaselineWeightsError(
            f"{path} is of format {found}; expected {(FORMAT, str(FORMAT_VERSION))}"
        )
    if content_sha256(metadata, tensors) != metadata.get(CHECKSUM):
        raise BaselineWeightsError(f"{path} is damaged: its content is not what was written")
    with interpreting(path, "the provenance of a baseline's weights"):
        return tensors, BaselineInfo(**json.loads(metadata["info"]))


def _content(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    try:
        with safe_open(path, framework="pt") as file:
            names = file.keys()
            return file.metadata() or {}, {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise BaselineWeightsError(f"{path} is damaged or no safetensors file: {error}") from error
