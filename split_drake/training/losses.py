"""Training losses: denoising score matching and the evaluator's focal loss (paper IV-D and V)."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from split_drake.split.network import SplitNetwork
from split_drake.training.batches import TrainingBatch

FOCAL_WEIGHT = 0.1
FOCAL_ALPHA = 0.25
FOCAL_GAMMA = 2.0


@dataclass(frozen=True)
class Losses:
    """The terms of the loss.

    Attributes:
        denoising: (T,) mean squared error of sigma * score by task, of those that are trained; 1 is
            what a network that always answers 0 reaches, about.
        focal: of the evaluator.
    """

    denoising: Tensor
    focal: Tensor

    @property
    def total(self) -> Tensor:
        """What is minimised: all tasks that are trained count the same."""
        return self.denoising.mean() + FOCAL_WEIGHT * self.focal


def focal_loss(logits: Tensor, label: Tensor) -> Tensor:
    """Return the mean focal loss (Lin et al. 2017) of `logits` for labels 0 and 1, any shape."""
    cross_entropy = functional.binary_cross_entropy_with_logits(logits, label, reduction="none")
    missed = torch.sigmoid(torch.where(label > 0.5, -logits, logits))
    weight = torch.where(label > 0.5, FOCAL_ALPHA, 1.0 - FOCAL_ALPHA)
    return (weight * missed**FOCAL_GAMMA * cross_entropy).mean()


def compute_losses(network: SplitNetwork, batch: TrainingBatch, bfloat16: bool) -> Losses:
    """Return the losses of `network` on `batch`.

    With `bfloat16`, matrix products and the finer convolutions run in that type; features, targets
    and losses are float32.
    """
    scenes, groups = batch.sigma.shape
    with torch.autocast(batch.occupied.device.type, torch.bfloat16, enabled=bfloat16):
        tables = network.encode(batch.occupied)
    context = network.local_context(tables, batch.X_VPs)
    context = context.view(*batch.label.shape, -1)
    tasks = batch.tasks.expand(scenes, -1)
    with torch.autocast(batch.occupied.device.type, torch.bfloat16, enabled=bfloat16):
        score = network.score(
            context[:, :groups].flatten(0, 1),
            tasks[:, :groups].reshape(-1),
            batch.sigma.flatten(),
        )
        logits = network.evaluate(context.flatten(0, 1), tasks.reshape(-1))
    squared = (score.float().view_as(batch.target) - batch.target).square().mean((0, 2, 3))
    by_task = [part.mean() for part in squared.split(batch.task_groups)]
    return Losses(
        torch.stack(by_task), focal_loss(logits.float().view_as(batch.label), batch.label)
    )
