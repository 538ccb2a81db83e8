"""PyTorch on one thread: what it computes depends on how many there are."""

import torch


def use_one_thread() -> None:
    """Have this process compute on one thread from now on."""
    torch.set_num_threads(1)
