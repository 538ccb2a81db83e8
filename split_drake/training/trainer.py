"""The training loop's state and one step of it; saved whole, so that a killed run can go on."""

import copy
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from split_drake.bad_input import BadInputError, require_count, require_number, require_numbers
from split_drake.files import replacing
from split_drake.split.network import SplitNetwork
from split_drake.split.network_config import SplitConfig
from split_drake.training.batches import BatchConfig, draw_batch
from split_drake.training.losses import Losses, compute_losses
from split_drake.training.training_scenes import TrainingScenes
from split_drake.training.workers.peers import Peers


class TrainingDivergedError(RuntimeError):
    """Losses or gradients stopped being finite."""


class StateError(BadInputError):
    """A file holds no state that this trainer can go on from."""


@dataclass(frozen=True)
class OptimizerConfig:
    """How the weights are moved.

    Attributes:
        learning_rate: of Adam, after the warm-up.
        warmup_steps: over which the learning rate rises from zero.
        hold: share of the run before the cosine decay begins.
        final_rate: learning rate at the end, relative to `learning_rate`.
        gradient_norm: gradients are clipped to this.
        average_decay: of the exponential average of the weights, which is what is shipped.
        tolerated_steps: steps in a row that may be skipped because a gradient was not finite.
    """

    learning_rate: float = 1e-3
    warmup_steps: int = 100
    hold: float = 0.1
    final_rate: float = 0.02
    gradient_norm: float = 1.0
    average_decay: float = 0.998
    tolerated_steps: int = 3

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("learning_rate", "gradient_norm"):
            if not getattr(self, name) > 0.0:
                raise BadInputError(f"{name} is {getattr(self, name)}; expected more than 0")
        for name in ("hold", "final_rate", "average_decay"):
            require_number(name, getattr(self, name), 0.0, 1.0)
        require_count("warmup_steps", self.warmup_steps, 1)
        require_count("tolerated_steps", self.tolerated_steps)

    def rate(self, step: int, progress: float) -> float:
        """Return the learning rate at `step`, a share `progress` in [0, 1] of the run."""
        warmup = min(1.0, (step + 1) / self.warmup_steps)
        decay = min(1.0, max(0.0, (progress - self.hold) / (1.0 - self.hold)))
        cosine = 0.5 * (1.0 + math.cos(math.pi * decay))
        return self.learning_rate * warmup * (self.final_rate + (1.0 - self.final_rate) * cosine)


@torch.no_grad()
def update_average(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Move the weights and buffers of `average` towards those of `network` by 1 - decay."""
    for mean, value in zip(
        average.state_dict().values(), network.state_dict().values(), strict=True
    ):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1.0 - decay)
        else:
            mean.copy_(value)


class Trainer:
    """Network, its average, optimiser and random state.

    Attributes:
        network: what is trained.
        average: exponential average of its weights, in inference mode.
        step: optimiser steps taken.
        elapsed_s: time spent training, over all runs that this one continues.
        peers: the processes that train the same network; None where this one is alone.
    """

    def __init__(
        self,
        scenes: TrainingScenes,
        split: SplitConfig,
        batch: BatchConfig,
        optimizer: OptimizerConfig,
        seed: int,
        bfloat16: bool,
    ) -> None:
        torch.manual_seed(seed)
        device = scenes.p_VSs.device
        self._scenes, self._split, self._batch = scenes, split, batch
        self._config, self._bfloat16 = optimizer, bfloat16
        self.network = SplitNetwork(split, scenes.tasks).to(device).train()
        self.average = copy.deepcopy(self.network).eval().requires_grad_(False)
        # The fused kernel is the only one that doesn't cost a tenth of a step on a CPU.
        self._adam = torch.optim.Adam(self.network.parameters(), betas=(0.9, 0.99), fused=True)
        self._generator = torch.Generator(device).manual_seed(seed)
        self._skipped = 0
        self.step = 0
        self.elapsed_s = 0.0
        self.peers: Peers | None = None

    def start_from(self, network: SplitNetwork) -> None:
        """Take over the weights of a network, see `SplitNetwork.take_over`."""
        self.network.take_over(network)
        self.average.take_over(network)

    def take_step(self, progress: float) -> Losses:
        """Train on one batch, at a share `progress` of the run; return the losses before it.

        Where there are peers, all have to take the step: the batch is made of one from each.

        Raises TrainingDivergedError, in all peers alike, after several steps in a row without a
        finite gradient; PeerLostError where a peer is gone.
        """
        for group in self._adam.param_groups:
            group["lr"] = self._config.rate(self.step, progress)
        generator = self._generator if self.peers is None else self.peers.generator(self._generator)
        batch = draw_batch(self._scenes, self._batch, self._split, generator)
        buffers = [buffer.clone() for buffer in self.network.buffers()]
        losses = compute_losses(self.network, batch, self._bfloat16)
        self._adam.zero_grad(set_to_none=True)
        losses.total.backward()
        if self.peers is not None:
            losses = self.peers.average(self.network, losses)
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self._config.gradient_norm)
        self._require_finite(norm, losses)
        if self._skipped:
            # The forward pass has put what was not finite into the statistics of the batch norms.
            for buffer, before in zip(self.network.buffers(), buffers, strict=True):
                buffer.copy_(before)
        else:
            self._adam.step()
            decay = min(self._config.average_decay, (1 + self.step) / (10 + self.step))
            update_average(self.average, self.network, decay)
        self.step += 1
        return losses

    def _require_finite(self, gradient_norm: Tensor, losses: Losses) -> None:
        """Count steps in a row whose gradient is not finite; raise where there are too many."""
        if torch.isfinite(gradient_norm):
            self._skipped = 0
            return
        self._skipped += 1
        if self._skipped > self._config.tolerated_steps:
            raise TrainingDivergedError(
                f"{self._skipped} steps in a row up to step {self.step} had a gradient norm of "
                f"{gradient_norm.item()} (losses {losses.denoising.tolist()}, focal "
                f"{losses.focal.item()}); lower the learning rate, or try without bfloat16"
            )

    def save(self, path: Path) -> None:
        """Write everything needed to go on, atomically."""
        state = {
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "adam": self._adam.state_dict(),
            "generator": self._generator.get_state(),
            "skipped": self._skipped,
            "step": self.step,
            "elapsed_s": self.elapsed_s,
        }
        with replacing(path) as temporary:
            torch.save(state, temporary)

    def restore(self, path: Path) -> None:
        """Go on from what `save` wrote; the configuration must be the same.

        Raises StateError where the file is damaged, or was written on another type of device.
        """
        state = self._load(path)
        generator = state["generator"]
        if not isinstance(generator, torch.Tensor):
            raise StateError(f"{path} is no state of a run: its generator is {generator!r:.40}")
        generator = generator.cpu()
        if len(generator) != len(self._generator.get_state()):
            raise StateError(
                f"{path} was written on another type of device, whose random numbers cannot be "
                f"continued on {self._generator.device.type}; resume the run where it was, or "
                "start a new one from its weights"
            )
        try:
            self.network.load_state_dict(state["network"])
            self.average.load_state_dict(state["average"])
            self._adam.load_state_dict(state["adam"])
            self._generator.set_state(generator)
            self.step, self.elapsed_s = int(state["step"]), float(state["elapsed_s"])
        except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            raise StateError(f"{path} is no state of this run: {error}") from error
        self._skipped = state.get("skipped", 0)  # absent where it was not counted yet

    def _load(self, path: Path) -> dict[str, Any]:
        """Return what `save` wrote, on the device of the scenes."""
        device = self._scenes.p_VSs.device
        try:
            state = torch.load(path, map_location=device, weights_only=True)
        except Exception as error:  # of a dozen kinds where bytes are damaged
            raise StateError(f"{path} is damaged or no state of a run: {error}") from error
        expected = {"network", "average", "adam", "generator", "step", "elapsed_s"}
        if not isinstance(state, dict) or not expected <= state.keys():
            raise StateError(f"{path} is no state of a run; expected {', '.join(sorted(expected))}")
        return state
