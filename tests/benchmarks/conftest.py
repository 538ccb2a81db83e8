"""Operations beside times: each benchmark is shown with its share of the machine's peak.

The peak is what a large float32 matrix product reaches here, on the same threads.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from timeit import repeat
from typing import Any

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture
from rich.console import Console
from rich.table import Table
from torch.nn import functional
from torch.utils.flop_counter import FlopCounterMode

THREADS = 2
PEAK_SIZE = 2048
ROWS = pytest.StashKey[list[dict[str, Any]]]()

Measure = Callable[[Callable[[], Any]], None]


def linear_flops(x: Any, weight: Any, *_: Any, out_shape: Any) -> int:
    """Return the operations of oneDNN's linear layer."""
    return 2 * math.prod(out_shape) * int(x[-1])


def convolution_flops(x: Any, weight: Any, *_: Any, out_shape: Any) -> int:
    """Return the operations of oneDNN's convolution."""
    return 2 * math.prod(out_shape) * math.prod(weight[1:])


# PyTorch does not count them.
OF_ONEDNN = {
    torch.ops.mkldnn._linear_pointwise: linear_flops,
    torch.ops.mkldnn._convolution_pointwise: convolution_flops,
}


def flops_of(call: Callable[[], Any]) -> int:
    """Return the floating-point operations of the call's matrix products and convolutions.

    Interpolation, norms and activations, some hundredths of these, are left out.
    """
    with (
        torch.inference_mode(),
        FlopCounterMode(display=False, custom_mapping=OF_ONEDNN) as counter,
    ):
        call()
    return counter.get_total_flops()


@pytest.fixture(scope="session")
def threads() -> Iterator[int]:
    """Return how many threads PyTorch uses during the benchmarks."""
    before = torch.get_num_threads()
    torch.set_num_threads(THREADS)
    yield THREADS
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def peak_flops(threads: int) -> float:
    """Return the operations a second of the fastest large product: by MKL, or by oneDNN."""
    a, b = torch.randn(2, PEAK_SIZE, PEAK_SIZE)
    pixels, kernels = a.T[None, :, :, None], b[:, :, None, None]
    ways = (partial(torch.mm, a, b), partial(functional.conv2d, pixels, kernels))
    fastest_s = min(min(repeat(way, number=1, repeat=8)) for way in ways)
    return 2.0 * PEAK_SIZE**3 / fastest_s


@pytest.fixture
def measure(
    benchmark: BenchmarkFixture, peak_flops: float, threads: int, request: pytest.FixtureRequest
) -> Measure:
    """Return what times a call and tells its operations."""

    def run(call: Callable[[], Any]) -> None:
        flops = flops_of(call)
        assert flops > 0
        benchmark(torch.inference_mode()(call))
        assert benchmark.stats is not None  # the call above sets them
        median_s = benchmark.stats["median"]
        flops_per_s = flops / median_s
        benchmark.extra_info |= {
            "threads": threads,
            "gflop": flops / 1e9,
            "gflop_per_s": flops_per_s / 1e9,
            "peak_gflop_per_s": peak_flops / 1e9,
            "share_of_peak": flops_per_s / peak_flops,
        }
        row = {"name": request.node.name, "median_s": median_s}
        request.config.stash.setdefault(ROWS, []).append(row | benchmark.extra_info)

    return run


def pytest_terminal_summary(config: pytest.Config) -> None:
    """Print the benchmarks' operations."""
    rows = config.stash.get(ROWS, [])
    if not rows:
        return
    title = f"{rows[0]['threads']} threads, peak {rows[0]['peak_gflop_per_s']:.0f} GFLOP/s"
    table = Table("benchmark", "median, ms", "GFLOP", "GFLOP/s", "of the peak", title=title)
    for row in rows:
        table.add_row(
            row["name"],
            f"{1e3 * row['median_s']:.2f}",
            f"{row['gflop']:.3f}",
            f"{row['gflop_per_s']:.0f}",
            f"{row['share_of_peak']:.0%}",
        )
    Console().print(table)
