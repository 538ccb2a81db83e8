"""Training batches: scenes are turned, shifted, scaled and made noisy, their poses perturbed.

Differs from the paper:
- Whether the evaluator should accept a pose follows from how far that pose was perturbed, not from
  the time t that its noise was drawn at: small noise is drawn at late times too, and the evaluator,
  which is not told the time, sees only the pose.
- The points' noise is drawn from 2 to 6 mm for each scene, rather than 5 mm for all.
"""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import torch
from torch import Tensor

from split_drake.pose_set import PoseTask
from split_drake.split.diffusion import NoiseSchedule, displacement, perturb, target_score
from split_drake.split.network import TASKS, SplitConfig
from split_drake.split.se3 import compose, so3_exp


class SceneArrays(Protocol):
    """What a data set offers for S scenes, in W."""

    @property
    def clouds(self) -> np.ndarray:
        """(S, 2000, 3) points without noise."""

    @property
    def grasps(self) -> np.ndarray:
        """(S, M, 4, 4) true grasps."""

    @property
    def grasp_negatives(self) -> np.ndarray:
        """(S, M, 4, 4) infeasible grasps."""

    @property
    def handles(self) -> np.ndarray:
        """(S, M, 4, 4) true handle poses."""

    @property
    def uprights(self) -> np.ndarray:
        """(S, M, 4, 4) true upright poses."""


@dataclass(frozen=True)
class BatchConfig:
    """What a batch is made of.

    Attributes:
        scenes: in a batch.
        grasps, handles, uprights: perturbed poses a scene.
        negatives: infeasible grasps a scene, for the evaluator.
        poses_per_sigma: poses of a scene that share one noise level.
        evaluator_time: the paper's t_th, see `evaluator_limit`.
        shift_m: largest shift along x and y.
        scale: largest relative change of all positions.
        noise_m: range of the standard deviation of the points' noise.
    """

    scenes: int = 8
    grasps: int = 64
    handles: int = 24
    uprights: int = 24
    negatives: int = 24
    poses_per_sigma: int = 4
    evaluator_time: float = 0.3
    shift_m: float = 0.02
    scale: float = 0.08
    noise_m: tuple[float, float] = (0.002, 0.006)

    def __post_init__(self) -> None:
        counts = (self.grasps, self.handles, self.uprights, self.negatives)
        if min(counts) < 1 or any(count % self.poses_per_sigma for count in counts):
            raise ValueError(
                f"grasps, handles, uprights, negatives = {counts}; expected positive multiples of "
                f"poses_per_sigma={self.poses_per_sigma}"
            )

    def evaluator_limit(self, noise: NoiseSchedule) -> float:
        """Return how far poses may be perturbed that the evaluator should accept.

        It bounds the root mean square of the six components, and is the schedule's sigma at
        `evaluator_time`: by default 0.097, about 0.1.  That is 1 cm and 10 degrees in all, as near
        to a true pose as `evaluate` asks of a good one.
        """
        return noise.sigma(torch.tensor(self.evaluator_time)).item()

    @property
    def task_counts(self) -> tuple[int, ...]:
        """Perturbed poses a scene, in the order of `TASKS`."""
        counts = {
            PoseTask.GRASP: self.grasps,
            PoseTask.HANDLE: self.handles,
            PoseTask.UPRIGHT: self.uprights,
        }
        return tuple(counts[task] for task in TASKS)


@dataclass(frozen=True)
class TrainingScenes:
    """A data set as tensors relative to the workspace's corner V.

    Attributes:
        p_VSs: (S, 2000, 3) points.
        X_VPs: for each of `TASKS`, (S, M, 4, 4) true poses.
        X_VGnegatives: (S, M, 4, 4) infeasible grasps.
    """

    p_VSs: Tensor
    X_VPs: tuple[Tensor, ...]
    X_VGnegatives: Tensor

    @classmethod
    def from_arrays(cls, arrays: SceneArrays, p_WV: np.ndarray, device: torch.device) -> Self:
        """Return the scenes of a data set whose workspace has its corner at `p_WV` (3,)."""
        offset = torch.tensor(p_WV, dtype=torch.float32, device=device)

        def poses(X_WPs: np.ndarray) -> Tensor:
            X = torch.tensor(X_WPs, dtype=torch.float32, device=device)
            X[..., :3, 3] -= offset
            return X

        points = torch.tensor(arrays.clouds, dtype=torch.float32, device=device) - offset
        true_poses = {
            PoseTask.GRASP: poses(arrays.grasps),
            PoseTask.HANDLE: poses(arrays.handles),
            PoseTask.UPRIGHT: poses(arrays.uprights),
        }
        return cls(points, tuple(true_poses[t] for t in TASKS), poses(arrays.grasp_negatives))

    def __len__(self) -> int:
        return len(self.p_VSs)


@dataclass(frozen=True)
class TrainingBatch:
    """Scenes, perturbed poses and what the network should say of them.

    Poses are in groups of `BatchConfig.poses_per_sigma`, each of one scene, task and noise level:
    G = (sum of the tasks' poses a scene) / poses_per_sigma, plus N groups of negatives.

    Attributes:
        occupied: (B, r, r, r) voxels.
        X_VPs: (B, (G + N) * poses_per_sigma, 4, 4); the negatives come last.
        tasks: (G + N,) indices into `TASKS`, the same for all scenes.
        sigma: (B, G).
        target: (B, G, poses_per_sigma, 6) sigma * score.
        label: (B, G + N, poses_per_sigma) 1 for poses that the evaluator should accept, else 0.
    """

    occupied: Tensor
    X_VPs: Tensor
    tasks: Tensor
    sigma: Tensor
    target: Tensor
    label: Tensor


@dataclass(frozen=True)
class Augmentation:
    """One similarity transform a scene: yaw about the workspace's vertical axis, scale, shift.

    Poses keep orthonormal rotations: only their positions are scaled.

    Attributes:
        R: (B, 3, 3).
        scale: (B,).
        p_VCenter: (3,) centre of the workspace on the table.
        shift: (B, 3).
    """

    R: Tensor
    scale: Tensor
    p_VCenter: Tensor
    shift: Tensor

    @classmethod
    def draw(cls, batch: BatchConfig, split: SplitConfig, generator: torch.Generator) -> Self:
        """Return random transforms for `batch.scenes` scenes."""
        device = generator.device
        uniform = torch.rand(batch.scenes, 4, generator=generator, device=device) * 2.0 - 1.0
        yaw, scale, shift = uniform[:, 0], uniform[:, 1], uniform[:, 2:]
        zero = torch.zeros_like(yaw)
        return cls(
            R=so3_exp(torch.stack([zero, zero, torch.pi * yaw], -1)),
            scale=1.0 + batch.scale * scale,
            p_VCenter=torch.tensor([split.edge_m / 2, split.edge_m / 2, split.table_m]).to(device),
            shift=batch.shift_m * torch.nn.functional.pad(shift, (0, 1)),
        )

    def points(self, p_Vs: Tensor) -> Tensor:
        """Return the points (B, N, 3) transformed."""
        turned = (p_Vs - self.p_VCenter) @ self.R.transpose(-1, -2)
        return turned * self.scale[:, None, None] + (self.p_VCenter + self.shift)[:, None]

    def poses(self, X_Vs: Tensor) -> Tensor:
        """Return the poses (B, N, 4, 4) transformed."""
        return compose(self.R[:, None] @ X_Vs[..., :3, :3], self.points(X_Vs[..., :3, 3]))


def voxelize(p_VSs: Tensor, split: SplitConfig) -> Tensor:
    """Return (B, r, r, r) voxels, true where one of the points (B, N, 3) lies: `Scene.grid`."""
    r = split.resolution
    index = torch.floor(p_VSs / split.edge_m * r).long()
    scene = torch.arange(len(p_VSs), device=p_VSs.device)[:, None]
    flat = ((scene * r + index[..., 0]) * r + index[..., 1]) * r + index[..., 2]
    inside = ((index >= 0) & (index < r)).all(-1)
    occupied = torch.zeros(len(p_VSs) * r**3, dtype=torch.bool, device=p_VSs.device)
    occupied[flat[inside]] = True
    return occupied.view(-1, r, r, r)


def _pick(X: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Return `count` random poses of each scene, (B, count, 4, 4) of (B, M, 4, 4)."""
    index = torch.randint(X.shape[1], (len(X), count), generator=generator, device=X.device)
    return X[torch.arange(len(X), device=X.device)[:, None], index]


def draw_batch(
    scenes: TrainingScenes, batch: BatchConfig, split: SplitConfig, generator: torch.Generator
) -> TrainingBatch:
    """Return a random batch; `generator` is on the scenes' device and the only source of chance."""
    device, per_sigma, noise = generator.device, batch.poses_per_sigma, split.noise
    chosen = torch.randint(len(scenes), (batch.scenes,), generator=generator, device=device)
    augment = Augmentation.draw(batch, split, generator)
    points = augment.points(scenes.p_VSs[chosen])
    low_m, high_m = batch.noise_m
    spread_m = low_m + (high_m - low_m) * torch.rand(
        batch.scenes, 1, 1, generator=generator, device=device
    )
    points = points + spread_m * torch.randn(points.shape, generator=generator, device=device)

    picked = [
        _pick(X[chosen], count, generator)
        for X, count in zip(scenes.X_VPs, batch.task_counts, strict=True)
    ]
    X_VPs = augment.poses(torch.cat(picked, 1))
    times = torch.rand(
        batch.scenes, X_VPs.shape[1] // per_sigma, generator=generator, device=device
    )
    sigma = noise.sigma(times)
    sigma_of_pose = sigma.repeat_interleave(per_sigma, 1)
    X_noisy = perturb(X_VPs, sigma_of_pose, noise.length_m, generator)
    # The target is that of the pose as it is, so poses may be kept inside the grid.
    X_noisy[..., :3, 3] = X_noisy[..., :3, 3].clamp(0.0, split.edge_m)
    target = target_score(X_VPs, X_noisy, sigma_of_pose, noise.length_m)
    moved = displacement(X_VPs, X_noisy, noise.length_m).square().mean(-1).sqrt()
    limit = batch.evaluator_limit(noise)

    negatives = augment.poses(_pick(scenes.X_VGnegatives[chosen], batch.negatives, generator))
    label = torch.cat([moved < limit, moved.new_zeros(negatives.shape[:2]).bool()], 1)
    groups = [count // per_sigma for count in (*batch.task_counts, batch.negatives)]
    task_of_group = torch.tensor([*range(len(TASKS)), TASKS.index(PoseTask.GRASP)], device=device)
    return TrainingBatch(
        occupied=voxelize(points, split),
        X_VPs=torch.cat([X_noisy, negatives], 1),
        tasks=task_of_group.repeat_interleave(torch.tensor(groups, device=device)),
        sigma=sigma,
        target=target.unflatten(1, (-1, per_sigma)),
        label=label.float().unflatten(1, (-1, per_sigma)),
    )
