"""SPLIT's encoder for single scenes.

Batch normalisation is folded into the convolutions.  On the CPU their weights lie as oneDNN reads
them: PyTorch lays them out anew in every call, and convolves single scenes in 3D by its own code,
two to six times as slow.  Both together take half the time.
"""

from typing import Any

from torch import Tensor, nn, ops
from torch._C import _nn
from torch.backends import mkldnn
from torch.nn.utils import fuse_conv_bn_eval

from split_drake.split.network import ConvBlock, ConvLayer, Encoder

# PyTorch's own compiler calls both operators; its stubs have only some of the arguments.
_reorder: Any = _nn.mkldnn_reorder_conv3d_weight


class InferenceEncoder:
    """What an `Encoder` returns for single scenes, up to rounding.

    Args:
        encoder: in evaluation mode; its weights must stay as they are.
        resolution: of the scenes' grids.
    """

    def __init__(self, encoder: Encoder, resolution: int) -> None:
        self._blocks = list[tuple[_FoldedLayer, _FoldedLayer | None]]()
        for block in encoder.blocks:
            assert isinstance(block, ConvBlock)
            reduce = _FoldedLayer(block.reduce, resolution)
            resolution //= 2
            refine = None if block.refine is None else _FoldedLayer(block.refine, resolution)
            self._blocks.append((reduce, refine))

    def __call__(self, x: Tensor) -> list[Tensor]:
        """Return the grids of `Encoder.forward` for `x` (1, 2, r, r, r); without gradients."""
        grids = [x]
        for reduce, refine in self._blocks:
            x = reduce(x)
            grids.append(x if refine is None else x + refine(x))
            x = grids[-1]
        return grids


class _FoldedLayer:
    """A `ConvLayer` of inputs (1, C, n, n, n) as one convolution and a ReLU."""

    def __init__(self, layer: ConvLayer, n: int) -> None:
        convolution, norm, _ = layer
        assert isinstance(convolution, nn.Conv3d) and isinstance(norm, nn.BatchNorm3d)
        folded = fuse_conv_bn_eval(convolution, norm)
        self._convolution = folded.requires_grad_(False)
        self._how = (list(folded.padding), list(folded.stride), list(folded.dilation))
        self._in_order: Tensor | None = None
        if folded.weight.device.type == "cpu" and mkldnn.is_available():
            shape = [1, folded.in_channels, n, n, n]
            self._in_order = _reorder(folded.weight.to_mkldnn(), *self._how, folded.groups, shape)

    def __call__(self, x: Tensor) -> Tensor:
        convolution = self._convolution
        if self._in_order is None:
            return convolution(x).relu_()
        return ops.mkldnn._convolution_pointwise(
            x,
            self._in_order,
            convolution.bias,
            *self._how,
            convolution.groups,
            "relu",
            [],
            "",
        )
