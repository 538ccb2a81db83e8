"""What is trained: a method of this room's `methods`, by its name."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import torch
from torch import Tensor, nn

from split_drake.bad_input import BadInputError
from split_drake.data.dataset import SceneDataset
from split_drake.experiments.room_files import constants_in

_ROOM = "split_drake.baselines.learning.methods"


class Lessons(ABC):
    """What a network learns from scenes, S of them.

    Attributes:
        network: what learns.
        bfloat16: whether matrix products are computed in that type while it learns.
    """

    network: nn.Module
    bfloat16: bool = False

    @abstractmethod
    def __len__(self) -> int:
        """Return S."""

    @abstractmethod
    def losses(
        self, chosen: Tensor, generator: torch.Generator, training: bool
    ) -> dict[str, Tensor]:
        """Return the terms of the loss, each (), of scenes (B,); their sum is minimised.

        Scenes are augmented only in `training`.
        """


@dataclass(frozen=True)
class Method:
    """A method that can be trained.

    Attributes:
        name: of the method.
        learning_rates: of Adam, by the first part of parameters' names; "" is that of all others.
        scenes: in a batch.
        prepare: returns the lessons of a dataset, given the folder of its fields (`draw_fields`)
            where the method learns from them.
    """

    name: str
    learning_rates: Mapping[str, float]
    scenes: int
    prepare: Callable[[SceneDataset, Path | None], Lessons]


@lru_cache(maxsize=1)
def methods() -> Mapping[str, Method]:
    """Return all methods by their names."""
    return constants_in(_ROOM, "METHOD", Method, lambda each: each.name)


def method_named(name: str) -> Method:
    """Return a method; BadInputError where there is none of that name."""
    if name not in methods():
        raise BadInputError(f"--method is {name!r}; expected one of {', '.join(sorted(methods()))}")
    return methods()[name]
