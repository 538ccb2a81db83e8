"""Training of a network's evaluator on grasps that the network drew and that were judged.

The evaluator alone, or all of the network: then the encoder learns what tells grasps that hold from
others, and the loss of its training keeps the score what it is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np
import torch
from torch import Tensor, nn

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.evaluation.calibration import area_under_curve
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.split.network import SplitNetwork
from split_drake.split.network_config import SplitConfig
from split_drake.training.augmentation import (
    AugmentationConfig,
    Similarity,
    add_noise,
    turned_alike,
    voxelize,
)
from split_drake.training.batches import BatchConfig, TrainingBatch, draw_batch
from split_drake.training.losses import compute_losses, focal_loss
from split_drake.training.precision import uses_bfloat16
from split_drake.training.training_scenes import TrainingScenes
from split_drake.tuning.judged_grasps import JudgedGrasps

# Of each so many shards the last is not trained on, but tells what tuning has brought.
HELD_OUT = 10
MEASURED_NOISE_M = 0.005
# Of the whole network: the judged grasps' weight beside the loss of training.
JUDGED_WEIGHT = 3.0
GRADIENT_NORM = 1.0


@dataclass(frozen=True)
class TuneConfig:
    """How the evaluator is tuned.

    Attributes:
        judged: folder written by `judge` or `judge-clutter`.
        data: dataset with the model's tasks, such as it was trained on.
        init: checkpoint to start from, best the one that drew the judged grasps.
        out: checkpoint to write.
        steps: optimiser steps.
        learning_rate: of Adam at the first step; it falls to 0 like a cosine.
        whole: whether the whole network is trained, and not its evaluator alone.
        seed: of the batches.
        batch: scenes, poses of other tasks (of all tasks where the whole network is trained) and
            false grasps in a step; there are as many scenes again of judged grasps, all of a
            scene's at once.
    """

    judged: Path
    data: Path
    init: Path
    out: Path
    steps: int = 3000
    learning_rate: float = 3e-4
    whole: bool = False
    seed: int = 0
    batch: BatchConfig = field(default_factory=lambda: BatchConfig(poses_of=((GRASP.name, 0),)))

    def __post_init__(self) -> None:
        require_numbers(self)
        count = self.batch.count(GRASP)
        if count and not self.whole:
            raise ValueError(
                f"batch.poses_of has {count} grasps; expected 0: the judged ones take their place"
            )
        if self.whole and not count:
            raise ValueError(
                "batch.poses_of has 0 grasps; expected some where the whole network is trained, "
                "such as --batch.poses-of grasp 64"
            )


@dataclass(frozen=True)
class JudgedScenes:
    """Judged grasps as tensors, relative to the workspace's corner V.

    Attributes:
        p_VSs: (S, 2000, 3) points without noise.
        X_VGs: (S, K, 4, 4) grasps.
        held: (S, K) 1 for those that hold, else 0.
    """

    p_VSs: Tensor
    X_VGs: Tensor
    held: Tensor

    @classmethod
    def split(cls, judged: JudgedGrasps) -> tuple[Self, Self]:
        """Return the scenes to train on, and those of the shards that are held out.

        Raises BadInputError where there are too few shards to hold one out.
        """
        held_out = judged.shard_index % HELD_OUT == HELD_OUT - 1
        if not held_out.any():
            raise BadInputError(
                f"{judged.shards} shards; expected at least {HELD_OUT}, to hold one out"
            )
        return cls._of(judged, ~held_out), cls._of(judged, held_out)

    @classmethod
    def _of(cls, judged: JudgedGrasps, rows: np.ndarray) -> Self:
        p_WV = torch.tensor(judged.workspace.p_WV, dtype=torch.float32)
        X_VGs = torch.tensor(judged.sampled[rows])
        X_VGs[..., :3, 3] -= p_WV
        return cls(
            torch.tensor(judged.clouds[rows]) - p_WV, X_VGs, torch.tensor(judged.held[rows]).float()
        )

    def __len__(self) -> int:
        return len(self.held)

    def draw(
        self, batch: BatchConfig, split: SplitConfig, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return voxels (B, r, r, r), grasps (B, K, 4, 4) and labels (B, K), augmented."""
        chosen = torch.randint(len(self), (batch.scenes,), generator=generator)
        similarity = Similarity.draw(batch.scenes, batch.augmentation, split, generator)
        points = similarity.points(self.p_VSs[chosen])
        X_VGs = turned_alike(similarity.poses(self.X_VGs[chosen]), GRASP.symmetry, generator)
        occupied = voxelize(add_noise(points, batch.augmentation, generator), split)
        return occupied, X_VGs, self.held[chosen]


def evaluator_logits(
    network: SplitNetwork, occupied: Tensor, X_VPs: Tensor, tasks: Tensor
) -> Tensor:
    """Return logits (B, P) of poses (B, P, 4, 4), with a gradient for the evaluator alone.

    Args:
        occupied: (B, r, r, r) voxels.
        tasks: (G,) indices into the network's tasks of the G groups that a scene's poses fall into.
    """
    with torch.no_grad():
        context = network.local_context(network.encode(occupied), X_VPs)
    grouped = context.view(len(occupied) * len(tasks), -1, context.shape[-1])
    return network.evaluate(grouped, tasks.repeat(len(occupied))).view(X_VPs.shape[:2])


@torch.no_grad()
def ranking_quality(network: SplitNetwork, judged: JudgedScenes) -> dict[str, float]:
    """Return how well the evaluator ranks the judged grasps, the points having 5 mm of noise.

    "auc" is over the grasps of all scenes, "top_holds" the share of scenes whose best one holds,
    "holds" that of all grasps, which is what chance would reach.
    """
    generator = torch.Generator().manual_seed(0)
    noise = AugmentationConfig(noise_m=(MEASURED_NOISE_M, MEASURED_NOISE_M))
    grasp = _grasp_of(network)
    logits: list[Array] = []
    for p_VSs, X_VGs in zip(judged.p_VSs.split(16), judged.X_VGs.split(16), strict=True):
        occupied = voxelize(add_noise(p_VSs, noise, generator), network.config)
        logits.append(evaluator_logits(network, occupied, X_VGs, grasp).numpy())
    scores, held = np.concatenate(logits), judged.held.bool().numpy()
    best = scores.argmax(axis=1)
    return {
        "auc": area_under_curve(scores.ravel(), held.ravel()),
        "top_holds": float(held[np.arange(len(held)), best].mean()),
        "holds": float(held.mean()),
    }


def tune_steps(
    network: SplitNetwork, scenes: TrainingScenes, judged: JudgedScenes, config: TuneConfig
) -> Iterator[float]:
    """Train `network`, or its evaluator alone; yield the loss of each step."""
    # The statistics of the encoder's batch norms stay as they are, whatever is trained.
    network.eval().requires_grad_(config.whole)
    for module in (network.evaluator_condition, network.evaluator_head):
        module.requires_grad_(True)
    tuned = [parameter for parameter in network.parameters() if parameter.requires_grad]
    adam = torch.optim.Adam(tuned, config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, config.steps)
    generator = torch.Generator().manual_seed(config.seed)
    bfloat16 = uses_bfloat16("auto")
    loss_of = partial(_whole_loss, bfloat16=bfloat16) if config.whole else _evaluator_loss
    for _ in range(config.steps):
        batch = draw_batch(scenes, config.batch, network.config, generator)
        drawn = judged.draw(config.batch, network.config, generator)
        loss = loss_of(network, batch, drawn)
        adam.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(tuned, GRADIENT_NORM)
        adam.step()
        schedule.step()
        yield loss.item()


def _evaluator_loss(
    network: SplitNetwork, batch: TrainingBatch, judged: tuple[Tensor, Tensor, Tensor]
) -> Tensor:
    """Return the loss of the evaluator alone."""
    occupied, X_VGs, held = judged
    others = evaluator_logits(network, batch.occupied, batch.X_VPs, batch.tasks)
    grasps = evaluator_logits(network, occupied, X_VGs, _grasp_of(network))
    return focal_loss(others, batch.label.flatten(1)) + focal_loss(grasps, held)


def _whole_loss(
    network: SplitNetwork,
    batch: TrainingBatch,
    judged: tuple[Tensor, Tensor, Tensor],
    bfloat16: bool,
) -> Tensor:
    """Return the loss of training, and that of judged grasps."""
    occupied, X_VGs, held = judged
    training = compute_losses(network, batch, bfloat16)
    with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
        tables = network.encode(occupied)
    context = network.local_context(tables, X_VGs)
    with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
        logits = network.evaluate(context, _grasp_of(network).repeat(len(occupied)))
    return training.total + JUDGED_WEIGHT * focal_loss(logits.float(), held)


def _grasp_of(network: SplitNetwork) -> Tensor:
    return torch.tensor([network.tasks.index(GRASP)])
