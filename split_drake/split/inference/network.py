"""SPLIT's network made ready for many scenes.

Batch normalisation is folded into the encoder's convolutions.  What task and noise level say
(FiLM), and what is learnt of layer normalisation, is folded into the heads' hidden layers, once for
each task and noise level.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils import fuse_conv_bn_eval

from split_drake.split.inference.layers import ReadyConvolution, ReadyLinear
from split_drake.split.network import ConvBlock, ConvLayer, Encoder, FilmMlp, SplitNetwork

# Layers of so many noise levels and tasks are kept, 1.5 MB each: three tasks have 12, with 16
# evaluations 48.  Of longer samplers those that come first are, so that they do not push each other
# out in turns.
_KEPT = 64


class InferenceEncoder:
    """What an `Encoder` returns for single scenes, up to rounding, in half the time.

    Args:
        encoder: in evaluation mode.
        resolution: of the scenes' grids.
    """

    def __init__(self, encoder: Encoder, resolution: int) -> None:
        self._blocks = list[tuple[ReadyConvolution, ReadyConvolution | None]]()
        for block in encoder.blocks:
            assert isinstance(block, ConvBlock)
            reduce = _folded(block.reduce, resolution)
            resolution //= 2
            refine = None if block.refine is None else _folded(block.refine, resolution)
            self._blocks.append((reduce, refine))

    def __call__(self, x: Tensor) -> list[Tensor]:
        """Return the grids of `Encoder.forward` for `x` (1, 2, r, r, r); without gradients."""
        grids = [x]
        for reduce, refine in self._blocks:
            coarse = reduce(grids[-1])
            grids.append(coarse if refine is None else coarse + refine(coarse))
        return grids


def _folded(layer: ConvLayer, n: int) -> ReadyConvolution:
    convolution, norm, _ = layer
    assert isinstance(convolution, nn.Conv3d) and isinstance(norm, nn.BatchNorm3d)
    return ReadyConvolution(fuse_conv_bn_eval(convolution, norm), n)


@dataclass(frozen=True)
class ConditionedLayers:
    """A head's layers for one condition.

    Attributes:
        scale, shift: (width,) of what the first layer puts out.
        hidden: the others but the last, each with SiLU; what comes in is normalised.
        eps: of the normalisations.
    """

    scale: Tensor
    shift: Tensor
    hidden: Sequence[ReadyLinear]
    eps: Sequence[float]


class InferenceHead:
    """A `FilmMlp` in two steps: its first layer, which is the caller's, and the others."""

    def __init__(self, mlp: FilmMlp) -> None:
        self._mlp = mlp

    @property
    def first(self) -> tuple[Tensor, Tensor]:
        """Weight (width, inputs) and bias (width,) of the first layer."""
        return self._mlp.input.weight.detach(), self._mlp.input.bias.detach()

    @torch.no_grad()
    def conditioned(self, condition: Tensor) -> ConditionedLayers:
        """Return the layers for a condition (conditions,)."""
        film = self._mlp.film(condition).view(-1, 2, self._mlp.width)
        scales, shifts = film[:, 0] + 1.0, film[:, 1]
        hidden, eps = list[ReadyLinear](), list[float]()
        for linear, norm, scale, shift in zip(
            self._mlp.hidden, self._mlp.norms, scales[1:], shifts[1:], strict=True
        ):
            assert isinstance(linear, nn.Linear) and isinstance(norm, nn.LayerNorm)
            bias = functional.linear(norm.bias.detach(), linear.weight, linear.bias) * scale + shift
            hidden.append(ReadyLinear(linear.weight * norm.weight * scale[:, None], bias, True))
            eps.append(norm.eps)
        return ConditionedLayers(scales[0], shifts[0], hidden, eps)

    def outputs(self, first: Tensor, layers: ConditionedLayers) -> Tensor:
        """Return the outputs (N, outputs), given those of the first layer (N, width)."""
        h = functional.silu(torch.addcmul(layers.shift, first, layers.scale), inplace=True)
        for layer, eps in zip(layers.hidden, layers.eps, strict=True):
            h = h + layer(functional.layer_norm(h, h.shape[1:], eps=eps))
        outputs: Tensor = self._mlp.output(h)
        return outputs


class InferenceNetwork:
    """A network whose layers are ready for inference.

    It may be copied and pickled, and is made anew then.

    Attributes:
        network: as given.
        encoder: for single scenes.
        score_head, evaluator_head: for single tasks.

    Args:
        network: in evaluation mode.  Weights and device must stay as they are: another one is to be
            made after a change.

    Raises ValueError where the network is being trained.
    """

    def __init__(self, network: SplitNetwork) -> None:
        if network.training:
            raise ValueError("the network is in training mode; expected evaluation mode")
        self.network = network
        self.encoder = InferenceEncoder(network.encoder, network.config.resolution)
        self.score_head = InferenceHead(network.score_head)
        self.evaluator_head = InferenceHead(network.evaluator_head)
        self._layers: dict[tuple[int, float | None], ConditionedLayers] = {}

    def __reduce__(self) -> tuple[type[Self], tuple[SplitNetwork]]:
        # Weights in oneDNN's order can be neither copied nor pickled.
        return type(self), (self.network,)

    def score_layers(self, task: int, sigma: float) -> ConditionedLayers:
        """Return the score head's layers for one of the network's tasks and a noise level."""
        return self._kept(task, sigma)

    def evaluator_layers(self, task: int) -> ConditionedLayers:
        """Return the evaluator head's layers for one of the network's tasks."""
        return self._kept(task, None)

    def _kept(self, task: int, sigma: float | None) -> ConditionedLayers:
        """Return the layers of the score head, or of the evaluator where there is no noise."""
        if (found := self._layers.get((task, sigma))) is not None:
            return found
        found = self._evaluator_layers(task) if sigma is None else self._score_layers(task, sigma)
        if len(self._layers) < _KEPT:
            self._layers[task, sigma] = found
        return found

    @torch.no_grad()
    def _score_layers(self, task: int, sigma: float) -> ConditionedLayers:
        angle = self.network.frequencies * math.log(sigma)
        condition = torch.cat([self._one_hot(task), angle.sin(), angle.cos()])
        return self.score_head.conditioned(self.network.score_condition(condition))

    @torch.no_grad()
    def _evaluator_layers(self, task: int) -> ConditionedLayers:
        condition = self.network.evaluator_condition(self._one_hot(task))
        return self.evaluator_head.conditioned(condition)

    def _one_hot(self, task: int) -> Tensor:
        number = torch.tensor(task, device=self.network.device)
        return functional.one_hot(number, len(self.network.tasks)).float()
