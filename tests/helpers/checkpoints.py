"""Checkpoints of networks that have learnt nothing."""

from pathlib import Path

import torch

from split_drake.pose_task import MUG_TASKS, PoseTask
from split_drake.scene import Workspace
from split_drake.split.checkpoint import CheckpointInfo, save_checkpoint
from split_drake.split.network import SplitNetwork
from tests.helpers.training import NETWORK


def new_network(tasks: tuple[PoseTask, ...] = MUG_TASKS) -> SplitNetwork:
    """Return a network that has learnt nothing."""
    torch.manual_seed(0)
    return SplitNetwork(NETWORK, tasks).eval()


def save_new_network(
    path: Path, workspace: Workspace | None = None, tasks: tuple[PoseTask, ...] = MUG_TASKS
) -> None:
    """Write a checkpoint of a network that has learnt nothing."""
    info = CheckpointInfo(
        config=NETWORK,
        tasks=tasks,
        workspace=workspace or Workspace(),
        training={},
        seed=0,
        dataset_hash="post",
        commit="abc",
        steps=7,
        scenes=56,
    )
    save_checkpoint(path, new_network(tasks), info)
