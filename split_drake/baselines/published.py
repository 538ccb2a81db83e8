"""Parameters that other methods' authors published: PyTorch state dictionaries, never pickles."""

from pathlib import Path
from typing import TypeVar

import torch
from torch import Tensor, nn

from split_drake.bad_input import BadInputError

Network = TypeVar("Network", bound=nn.Module)
_SHOWN = 3


class PublishedWeightsError(BadInputError):
    """A file does not hold the parameters of the network that they are wanted for."""


def load_published(network: Network, path: Path) -> Network:
    """Return the network with the parameters of a file, which has all of them and no others.

    Raises PublishedWeightsError where the file cannot be read, or holds those of another network.
    """
    return fitted(network, path, _state_dictionary(path))


def fitted(network: Network, path: Path, given: dict[str, Tensor]) -> Network:
    """Return the network with parameters that came from a file; see `load_published`."""
    expected = network.state_dict()
    named = type(network).__name__
    for what, names in (
        ("lacks", sorted(expected.keys() - given.keys())),
        ("has beside them", sorted(given.keys() - expected.keys())),
    ):
        if names:
            raise PublishedWeightsError(
                f"{path} does not hold the parameters of {named}: it {what} {_listed(names)}"
            )
    for name, wanted in expected.items():
        if given[name].shape != wanted.shape:
            raise PublishedWeightsError(
                f"{path} does not hold the parameters of {named}: {name} has shape "
                f"{tuple(given[name].shape)}, expected {tuple(wanted.shape)}"
            )
        if not torch.isfinite(given[name]).all():
            raise PublishedWeightsError(f"{path} holds NaN or infinite numbers in {name}")
    network.load_state_dict(given)
    return network


def _state_dictionary(path: Path) -> dict[str, Tensor]:
    try:
        # Nothing but tensors is read, so that no code of a file runs.
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds, of which none says which file it was
        first = str(error).partition("\n")[0]
        raise PublishedWeightsError(f"{path} is no PyTorch state dictionary: {first}") from error
    if not isinstance(content, dict) or not all(
        isinstance(name, str) and isinstance(value, Tensor) for name, value in content.items()
    ):
        raise PublishedWeightsError(
            f"{path} is no state dictionary; expected tensors by their names"
        )
    return content


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
