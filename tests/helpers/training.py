"""Scenes that are quickly learnt, a small network, and settings to match."""

from dataclasses import dataclass

import numpy as np
import torch

from split_drake.data.grasp_candidates import GraspState
from split_drake.poses import make_pose, rotation_x, rotation_z
from split_drake.scene import Workspace
from split_drake.split.network import SplitConfig
from split_drake.training import batches, trainer
from split_drake.training.training_scenes import TrainingScenes

NETWORK = SplitConfig(channels=(4, 8, 8), context_grids=(0, 1, 3), width=32, layers=4)
BATCH = batches.BatchConfig(scenes=4, grasps=8, handles=8, uprights=8, negatives=4)
OPTIMIZER = trainer.OptimizerConfig(learning_rate=3e-3, warmup_steps=5)

# Heights of the grasp candidates above the foot of a post of the first kind.
FIRM_M, WEAK_M, BLOCKED_M, FALSE_M = 0.1, 0.08, 0.06, 0.3
LONGER_M = 0.01


@dataclass(frozen=True)
class PostScenes:
    """Scenes of posts with a knob on one side: the top is grasped, the foot stood on the table."""

    clouds: np.ndarray
    X_WOs: np.ndarray
    mug_index: np.ndarray
    X_OGs: np.ndarray
    qualities: np.ndarray
    grasp_states: np.ndarray
    handles: np.ndarray
    uprights: np.ndarray
    dataset_hash: str = "post"


def make_scenes(count: int = 12) -> PostScenes:
    """Return posts 10 cm high at random places of the default workspace, in W.

    There are two kinds, in turns of two scenes; those of the second are grasped higher by LONGER_M.
    Candidates: a firm grasp, one of half its weight, one that is blocked in odd scenes, a false
    one, and padding.
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
    X_OGs = np.tile(np.eye(4), (2, 5, 1, 1))
    heights_m = np.array([FIRM_M, WEAK_M, BLOCKED_M, FALSE_M])
    X_OGs[:, :4, 2, 3] = np.stack([heights_m, heights_m + LONGER_M])
    true, false, padding = GraspState.TRUE, GraspState.FALSE, GraspState.PADDING
    states = np.tile(np.array([true, true, true, false, padding], dtype=np.uint8), (count, 1))
    states[1::2, 2] = false
    X_OHs = make_pose(np.stack([np.eye(3), rotation_x(np.pi)]), np.array([[0.04, 0.0, 0.05]] * 2))
    return PostScenes(
        clouds=clouds.astype(np.float32),
        X_WOs=X_WO,
        mug_index=np.arange(count) // 2 % 2,
        X_OGs=X_OGs,
        qualities=np.array([[1.0, 0.5, 0.5, 0.0, 0.0]] * 2),
        grasp_states=states,
        handles=X_WO[:, None] @ X_OHs,
        uprights=X_WO[:, None],
    )


def scenes_on_cpu() -> TrainingScenes:
    """Return the scenes as tensors."""
    cpu = torch.device("cpu")
    return TrainingScenes.from_arrays(make_scenes(), Workspace().p_WV, cpu)
