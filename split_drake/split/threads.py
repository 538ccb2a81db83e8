"""PyTorch's threads: what it computes depends on how many there are."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


def use_one_thread() -> None:
    """Have this process compute on one thread from now on."""
    torch.set_num_threads(1)


@contextmanager
def on_threads(count: int) -> Iterator[None]:
    """Have this process compute on a number of threads for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
