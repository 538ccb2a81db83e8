"""A network while it learns: epochs over scenes, and the weights that did best on others."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from split_drake.baselines.learning.method import Lessons, Method
from split_drake.files import replacing
from split_drake.training.trainer import StateError, TrainingDivergedError

# Of the scenes, so many are not trained on, at most; weights are chosen by them.
HELD_SHARE, HELD_MOST = 0.05, 400
_STATE = ("network", "best", "adam", "generator", "counts")


class Pupil:
    """Network, optimiser and random state, over epochs.

    Attributes:
        network: what learns.
        best: its parameters after the epoch with the least loss on held-out scenes.
        step: optimiser steps taken.
        best_step: of `best`; 0 where no epoch has ended.
        best_loss: of `best`, on held-out scenes.
        elapsed_s: time spent training, over all runs that this one continues.

    Args:
        method: what is trained.
        lessons: its network, and scenes, two at least.
        seed: of order, batches and held-out scenes.
    """

    def __init__(self, method: Method, lessons: Lessons, seed: int) -> None:
        self._method, self._lessons, self._seed = method, lessons, seed
        self.network = lessons.network.train()
        self.best = copy.deepcopy(self.network.state_dict())
        self._adam = torch.optim.Adam(_groups(self.network, method.learning_rates), fused=True)
        self._generator = torch.Generator().manual_seed(seed)
        order = torch.randperm(len(lessons), generator=torch.Generator().manual_seed(seed))
        held = min(HELD_MOST, max(1, round(HELD_SHARE * len(lessons))))
        self._held, self._trained = order[:held], order[held:]
        self.step = self.best_step = 0
        self.best_loss = float("inf")
        self.elapsed_s = 0.0

    @property
    def steps_per_epoch(self) -> int:
        """Optimiser steps of an epoch; a last batch that is not full is left out."""
        return max(1, len(self._trained) // self._method.scenes)

    @property
    def epoch_ended(self) -> bool:
        """Whether an epoch ended with the last step."""
        return self.step > 0 and self.step % self.steps_per_epoch == 0

    def take_step(self) -> dict[str, float]:
        """Train on the next batch; return the terms of its loss before.

        Raises TrainingDivergedError where the loss is not finite.
        """
        losses = self._lessons.losses(self._batch(), self._generator, training=True)
        total = torch.stack(list(losses.values())).sum()
        if not torch.isfinite(total):
            raise TrainingDivergedError(f"the loss after step {self.step} is {total.item()}")
        self._adam.zero_grad(set_to_none=True)
        total.backward()
        self._adam.step()
        self.step += 1
        return {name: value.item() for name, value in losses.items()}

    def _batch(self) -> Tensor:
        """Return the scenes of the next step; each epoch has an order of its own."""
        epoch, number = divmod(self.step, self.steps_per_epoch)
        generator = torch.Generator().manual_seed(self._seed + 1 + epoch)
        order = torch.randperm(len(self._trained), generator=generator)
        first = number * self._method.scenes
        return self._trained[order[first : first + self._method.scenes]]

    def examine(self) -> dict[str, float]:
        """Return the terms of the loss on held-out scenes; keep the weights that did best."""
        self.network.eval()
        # The same draws every time, so that epochs are compared fairly.
        generator = torch.Generator().manual_seed(self._seed)
        sums: dict[str, float] = {}
        for part in self._held.split(self._method.scenes):
            for name, value in self._examined(part, generator).items():
                sums[name] = sums.get(name, 0.0) + value.item() * len(part) / len(self._held)
        self.network.train()
        if (total := sum(sums.values())) < self.best_loss:
            self.best_loss, self.best_step = total, self.step
            self.best = copy.deepcopy(self.network.state_dict())
        return sums

    def _examined(self, part: Tensor, generator: torch.Generator) -> Mapping[str, Tensor]:
        with torch.no_grad():
            return self._lessons.losses(part, generator, training=False)

    def save(self, path: Path) -> None:
        """Write all that it takes to go on, atomically."""
        state = {
            "network": self.network.state_dict(),
            "best": self.best,
            "adam": self._adam.state_dict(),
            "generator": self._generator.get_state(),
            "counts": {
                "step": self.step,
                "best_step": self.best_step,
                "best_loss": self.best_loss,
                "elapsed_s": self.elapsed_s,
            },
        }
        with replacing(path) as temporary:
            torch.save(state, temporary)

    def restore(self, path: Path) -> None:
        """Go on from what `save` wrote; StateError where the file is damaged, or of another run."""
        state = _read(path)
        try:
            self.network.load_state_dict(state["network"])
            self.best = state["best"]
            self._adam.load_state_dict(state["adam"])
            self._generator.set_state(state["generator"])
            counts = state["counts"]
            self.step, self.best_step = int(counts["step"]), int(counts["best_step"])
            self.best_loss = float(counts["best_loss"])
            self.elapsed_s = float(counts["elapsed_s"])
        except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise StateError(f"{path} is no state of this run: {error}") from error


def _read(path: Path) -> dict[str, Any]:
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # of a dozen kinds where bytes are damaged
        raise StateError(f"{path} is damaged or no state of a run: {error}") from error
    if not isinstance(state, dict) or not set(_STATE) <= state.keys():
        raise StateError(f"{path} is no state of a run; expected {', '.join(_STATE)}")
    return state


def _groups(network: nn.Module, rates: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return the parameters in groups with their learning rates."""
    groups: dict[str, list[nn.Parameter]] = {}
    for name, parameter in network.named_parameters():
        first = name.partition(".")[0]
        groups.setdefault(first if first in rates else "", []).append(parameter)
    return [{"params": group, "lr": rates[first]} for first, group in groups.items()]
