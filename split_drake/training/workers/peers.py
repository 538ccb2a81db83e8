"""What one of several processes shares with the others in a step: seeds, gradients, statistics."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import torch
from torch import Tensor, distributed, nn

from split_drake.training.losses import Losses

# A process that has not answered for so long never will; a step takes about a second.
_PATIENCE = timedelta(minutes=5)
# What batch norms keep for inference.
_RUNNING = ("running_mean", "running_var")


class PeerLostError(RuntimeError):
    """Another process ended, or has not answered for minutes."""


class Peers:
    """This process among those that train one network.

    Attributes:
        rank: of this process, from 0.
        count: of the processes.
    """

    def __init__(self, rank: int, count: int) -> None:
        self.rank, self.count = rank, count

    def generator(self, of_run: torch.Generator) -> torch.Generator:
        """Return what this process draws its share of the next batch from.

        The run's generator is in the same state in all processes, and here moves on alike in all.
        It is thus all that has to be saved, and another number of processes can go on from it.
        """
        seeds = torch.randint(2**63 - 1, (self.count,), generator=of_run)
        return torch.Generator().manual_seed(int(seeds[self.rank]))

    @torch.no_grad()
    def average(self, network: nn.Module, losses: Losses) -> Losses:
        """Average the gradients of `network` over all processes in place; return the mean losses.

        All shares of a batch have the same size, so the mean gradient is that of the whole batch,
        but for the batch norms.  These normalise by the statistics of a process's own share.  Their
        running statistics are averaged here too, in every step: so all processes hold the same
        network at all times, and a step that one has to skip leaves no trace in any.

        Raises PeerLostError.
        """
        gradients = [p.grad for p in network.parameters() if p.grad is not None]
        values = [*gradients, *_running_statistics(network)]
        tasks = len(losses.denoising)
        # One message, since many small ones would wait for one another.
        parts = [value.flatten() for value in (*values, losses.denoising, losses.focal)]
        flat = torch.cat(parts)
        try:
            distributed.all_reduce(flat)
        except RuntimeError as error:
            raise PeerLostError(f"gradients could not be averaged: {error}") from error
        *means, denoising, focal = flat.div_(self.count).split([len(part) for part in parts])
        for value, mean in zip(values, means, strict=True):
            value.copy_(mean.view_as(value))
        return Losses(denoising.view(tasks), focal.view(()))


def _running_statistics(network: nn.Module) -> list[Tensor]:
    """Return the means and variances that the batch norms keep for inference."""
    return [
        buffer for name, buffer in network.named_buffers() if name.rpartition(".")[2] in _RUNNING
    ]


@contextmanager
def joined(rank: int, count: int, meeting: Path) -> Iterator[Peers]:
    """Yield the peers once all `count` processes have come to the file `meeting`.

    Raises PeerLostError where one does not come.
    """
    # Other machines are to have no part in it.
    loopback = next(name for _, name in socket.if_nameindex() if name.startswith("lo"))
    os.environ.setdefault("GLOO_SOCKET_IFNAME", loopback)
    store = distributed.FileStore(str(meeting), count)
    try:
        distributed.init_process_group(
            "gloo", store=store, rank=rank, world_size=count, timeout=_PATIENCE
        )
    except RuntimeError as error:
        raise PeerLostError(f"the processes did not find one another: {error}") from error
    try:
        yield Peers(rank, count)
    finally:
        distributed.destroy_process_group()
