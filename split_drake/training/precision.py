"""Which type of numbers is computed in: what the processor does in hardware."""

import time
from typing import Literal

import torch

Precision = Literal["auto", "float32", "bfloat16"]

# A matrix product of this size tells: bfloat16 is several times faster or slower, never about even.
_SIZE, _REPEATS = 768, 3


CPU = torch.device("cpu")


def uses_bfloat16(precision: Precision, device: torch.device = CPU) -> bool:
    """Return whether to compute in bfloat16; "auto" measures which type is faster on the device."""
    if precision != "auto":
        return precision == "bfloat16"
    return _seconds(torch.bfloat16, device) < _seconds(torch.float32, device)


def _seconds(kind: torch.dtype, device: torch.device) -> float:
    """Return the least time that a matrix product takes."""
    x = torch.ones(_SIZE, _SIZE, dtype=kind, device=device)
    best = float("inf")
    for _ in range(_REPEATS + 1):  # the first one warms up
        started = time.perf_counter()
        (x @ x).sum().item()
        best = min(best, time.perf_counter() - started)
    return best
