"""Scenes that are quickly learnt, a small network, and settings to match."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from split_drake.data.dataset import TaskLabels
from split_drake.data.labels import PoseState
from split_drake.pose_task import MUG_TASKS, PoseTask
from split_drake.poses import Array, make_pose, rotation_z
from split_drake.scene import Workspace
from split_drake.split.network_config import SplitConfig
from split_drake.training import batches, trainer
from split_drake.training.training_scenes import TrainingScenes

NETWORK = SplitConfig(channels=(4, 8, 8), context_grids=(0, 1, 3), width=32, layers=4)
BATCH = batches.BatchConfig(scenes=4, poses=8, poses_of=(), negatives=4)
OPTIMIZER = trainer.OptimizerConfig(learning_rate=3e-3, warmup_steps=5)

# Heights of the grasp candidates above the foot of a post of the first kind.
FIRM_M, WEAK_M, BLOCKED_M, FALSE_M = 0.1, 0.08, 0.06, 0.3
LONGER_M = 0.01


@dataclass(frozen=True)
class PostScenes:
    """Scenes of posts with a knob on one side: the top is grasped, the foot stood on the table."""

    clouds: np.ndarray
    X_WOs: np.ndarray
    p_WCs: np.ndarray
    object_index: np.ndarray
    labels: Mapping[str, TaskLabels]
    tasks: tuple[PoseTask, ...] = MUG_TASKS
    workspace: Workspace = field(default_factory=Workspace)
    dataset_hash: str = "post"


def make_scenes(count: int = 12) -> PostScenes:
    """Return posts 10 cm high at random places of the default workspace, in W.

    There are two kinds, in turns of two scenes; those of the second are grasped higher by LONGER_M.
    """
    rng = np.random.default_rng(0)
    yaw = rng.uniform(0.0, 2.0 * np.pi, count)
    p_WO = np.column_stack([rng.uniform(0.46, 0.54, count), rng.uniform(-0.04, 0.04, count)])
    X_WO = make_pose(
        np.stack([rotation_z(a) for a in yaw]), np.column_stack([p_WO, np.zeros(count)])
    )
    surface = rng.uniform((-0.02, -0.02, 0.005), (0.02, 0.02, 0.1), (2000, 3))
    surface[:200] = rng.uniform((0.02, -0.005, 0.04), (0.05, 0.005, 0.06), (200, 3))
    clouds = surface @ np.swapaxes(X_WO[:, :3, :3], -1, -2) + X_WO[:, None, :3, 3]
    return PostScenes(
        clouds=clouds.astype(np.float32),
        X_WOs=X_WO,
        p_WCs=np.tile((0.5, 0.0, 0.6), (count, 1)),
        object_index=np.arange(count) // 2 % 2,
        labels={
            "grasp": grasp_labels(count),
            "handle": fixed_labels(make_pose(p=(0.04, 0.0, 0.05)), count),
            "upright": fixed_labels(np.eye(4), count),
        },
    )


def grasp_labels(count: int) -> TaskLabels:
    """Return the grasps of both kinds of posts, in so many scenes.

    They are a firm grasp, one of half its weight, one that is blocked in odd scenes, a false one,
    and padding.
    """
    X_OGs = np.tile(np.eye(4, dtype=np.float32), (2, 5, 1, 1))
    heights_m = np.array([FIRM_M, WEAK_M, BLOCKED_M, FALSE_M])
    X_OGs[:, :4, 2, 3] = np.stack([heights_m, heights_m + LONGER_M])
    true, false, padding = PoseState.TRUE, PoseState.FALSE, PoseState.PADDING
    states = np.tile(np.array([true, true, true, false, padding], dtype=np.uint8), (count, 1))
    states[1::2, 2] = false
    weights = np.array([[1.0, 0.5, 0.5, 0.0, 0.0]] * 2, dtype=np.float32)
    return TaskLabels(X_OGs, weights, states)


def fixed_labels(X_OP: Array, count: int) -> TaskLabels:
    """Return one pose (4, 4) of both kinds of posts that is true in all of so many scenes."""
    return TaskLabels(
        X_OPs=np.tile(X_OP.astype(np.float32), (2, 1, 1, 1)),
        weights=np.ones((2, 1), dtype=np.float32),
        states=np.full((count, 1), PoseState.TRUE, dtype=np.uint8),
    )


def scenes_on_cpu(tasks: Sequence[PoseTask] = MUG_TASKS) -> TrainingScenes:
    """Return the scenes as tensors, with the labels of some tasks."""
    return TrainingScenes.of(make_scenes(), tasks, torch.device("cpu"))
