"""Scenes that are quickly learnt, a small network, and settings to match."""

from dataclasses import dataclass

import numpy as np
import torch

from split_drake.poses import make_pose, rotation_z
from split_drake.scene import Workspace
from split_drake.split.network import SplitConfig
from split_drake.training import batches, trainer

NETWORK = SplitConfig(channels=(4, 8, 8), context_grids=(0, 1, 3), width=32, layers=4)
BATCH = batches.BatchConfig(scenes=4, grasps=8, handles=8, uprights=8, negatives=4)
OPTIMIZER = trainer.OptimizerConfig(learning_rate=3e-3, warmup_steps=5)


@dataclass(frozen=True)
class PostScenes:
    """Scenes of a post with a knob on one side: its top is grasped, its foot stood on the table."""

    clouds: np.ndarray
    grasps: np.ndarray
    grasp_negatives: np.ndarray
    handles: np.ndarray
    uprights: np.ndarray
    dataset_hash: str = "post"


def make_scenes(count: int = 12) -> PostScenes:
    """Return posts 10 cm high at random places of the default workspace, in W."""
    rng = np.random.default_rng(0)
    yaw = rng.uniform(0.0, 2.0 * np.pi, count)
    p_WO = np.column_stack([rng.uniform(0.46, 0.54, count), rng.uniform(-0.04, 0.04, count)])
    X_WO = make_pose(
        np.stack([rotation_z(a) for a in yaw]), np.column_stack([p_WO, np.zeros(count)])
    )
    surface = rng.uniform((-0.02, -0.02, 0.005), (0.02, 0.02, 0.1), (2000, 3))
    surface[:200] = rng.uniform((0.02, -0.005, 0.04), (0.05, 0.005, 0.06), (200, 3))
    clouds = surface @ np.swapaxes(X_WO[:, :3, :3], -1, -2) + X_WO[:, None, :3, 3]

    def attach(*positions: tuple[float, float, float]) -> np.ndarray:
        return X_WO[:, None] @ make_pose(p=np.array(positions))

    return PostScenes(
        clouds=clouds.astype(np.float32),
        grasps=attach((0.0, 0.0, 0.1), (0.0, 0.0, 0.08)),
        grasp_negatives=attach((0.0, 0.0, 0.3)),
        handles=attach((0.04, 0.0, 0.05)),
        uprights=attach((0.0, 0.0, 0.0)),
    )


def scenes_on_cpu() -> batches.TrainingScenes:
    """Return the scenes as tensors."""
    cpu = torch.device("cpu")
    return batches.TrainingScenes.from_arrays(make_scenes(), Workspace().p_WV, cpu)
