"""Layers whose weights lie as oneDNN reads them, where it computes.

PyTorch lays weights out anew in every call, hands linear layers to MKL, which has AVX-512 for
Intel's processors alone, and convolves single volumes in 3D by its own code, two to six times as
slow as oneDNN.
"""

from typing import Any

import torch
from torch import Tensor, nn, ops
from torch._C import _nn
from torch.nn import functional

# PyTorch's own compiler calls these operators; its stubs have only some of the arguments.
_reorder_convolution: Any = _nn.mkldnn_reorder_conv3d_weight
# oneDNN lays weights out for a number of rows; it computes any other number by them, too.
_ROWS = 256


def by_onednn(weight: Tensor) -> bool:
    """Return whether oneDNN computes with weights like these."""
    is_float = weight.device.type == "cpu" and weight.dtype == torch.float32
    return is_float and torch.backends.mkldnn.is_available()


class ReadyLinear:
    """A linear layer, and SiLU after it where that is asked for.

    Args:
        weight: (outputs, inputs).
        bias: (outputs,).
        silu: whether it follows.
    """

    def __init__(self, weight: Tensor, bias: Tensor, silu: bool = False) -> None:
        self._by_onednn, self._silu = by_onednn(weight), silu
        self._weight, self._bias = weight, bias
        if self._by_onednn:
            self._weight = ops.mkldnn._reorder_linear_weight(weight.contiguous(), _ROWS)

    def __call__(self, x: Tensor) -> Tensor:
        """Return (N, outputs) for `x` (N, inputs); without gradients."""
        if self._by_onednn:
            after = "swish" if self._silu else "none"
            y: Tensor = ops.mkldnn._linear_pointwise(x, self._weight, self._bias, after, [], "")
            return y
        y = functional.linear(x, self._weight, self._bias)
        return functional.silu(y, inplace=True) if self._silu else y


class ReadyConvolution:
    """A 3D convolution of single volumes (1, C, n, n, n), and ReLU after it."""

    def __init__(self, convolution: nn.Conv3d, n: int) -> None:
        self._convolution = convolution
        self._how = tuple(
            list(each) for each in (convolution.padding, convolution.stride, convolution.dilation)
        )
        self._weight: Tensor | None = None
        if by_onednn(convolution.weight):
            shape = [1, convolution.in_channels, n, n, n]
            self._weight = _reorder_convolution(
                convolution.weight.detach().to_mkldnn(), *self._how, convolution.groups, shape
            )

    def __call__(self, x: Tensor) -> Tensor:
        """Return (1, outputs, n/stride, ...) for `x` (1, C, n, n, n); without gradients."""
        convolution = self._convolution
        if self._weight is None:
            return functional.relu(convolution(x), inplace=True)
        bias, groups = convolution.bias, convolution.groups
        y: Tensor = ops.mkldnn._convolution_pointwise(
            x, self._weight, bias, *self._how, groups, "relu", [], ""
        )
        return y
