"""Training batches: augmented scenes, perturbed poses, and what the network should say of them.

Differs from the paper: whether the evaluator should accept a pose follows from how far that pose
was perturbed, not from the time t that its noise was drawn at: small noise is drawn at late times
too, and the evaluator, which is not told the time, sees only the pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import torch
from torch import Tensor

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.pose_task import PoseTask
from split_drake.split.diffusion import NoiseSchedule, displacement, perturb, target_score
from split_drake.split.network_config import SplitConfig
from split_drake.training.augmentation import (
    AugmentationConfig,
    Similarity,
    add_noise,
    misjudge_range,
    turned_alike,
    voxelize,
)
from split_drake.training.training_scenes import TrainingScenes

# Of tasks that have more poses a scene than others; they may be absent.
_POSES_OF = (("grasp", 64),)


@dataclass(frozen=True)
class BatchConfig:
    """What a batch is made of.

    Attributes:
        scenes: in a batch.
        poses: perturbed poses a scene, of each task.
        poses_of: (task, number) of those tasks that have another number; a task of 0 poses is not
            trained.
        negatives: false poses a scene, of each task that has any, for the evaluator.
        poses_per_sigma: poses of a scene that share one noise level.
        evaluator_time: the paper's t_th, see `evaluator_limit`.
        augmentation: how much scenes are changed.
    """

    scenes: int = 8
    poses: int = 24
    poses_of: tuple[tuple[str, int], ...] = _POSES_OF
    negatives: int = 24
    poses_per_sigma: int = 4
    evaluator_time: float = 0.3
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.scenes < 1 or self.poses_per_sigma < 1:
            raise ValueError(
                f"scenes={self.scenes}, poses_per_sigma={self.poses_per_sigma}; expected 1 or more"
            )
        counts = (("poses", self.poses), ("negatives", self.negatives), *self.poses_of)
        for name, count in counts:
            if count < 0 or count % self.poses_per_sigma:
                raise ValueError(
                    f"{name} is {count}; expected 0 or a positive multiple of "
                    f"poses_per_sigma={self.poses_per_sigma}"
                )

    def share(self, count: int) -> Self:
        """Return one of `count` equal parts of a batch; they have to divide its scenes."""
        return replace(self, scenes=self.scenes // count)

    def evaluator_limit(self, noise: NoiseSchedule) -> float:
        """Return how far poses may be perturbed that the evaluator should accept.

        It bounds the root mean square of the six components, and is the schedule's sigma at
        `evaluator_time`: by default 0.097, about 0.1.  That is 1 cm and 10 degrees in all, as near
        to a true pose as `evaluate` asks of a good one.
        """
        return noise.sigma(torch.tensor(self.evaluator_time)).item()

    def count(self, task: PoseTask) -> int:
        """Return how many perturbed poses of a task a scene has."""
        return dict(self.poses_of).get(task.name, self.poses)

    def trained(self, tasks: Sequence[PoseTask]) -> tuple[PoseTask, ...]:
        """Return those of the tasks that are trained.

        Raises BadInputError where none is, or where `poses_of` names another task.
        """
        names = {task.name for task in tasks}
        for name, count in self.poses_of:
            if name not in names and (name, count) not in _POSES_OF:
                raise BadInputError(
                    f"poses_of names {name!r}; expected one of {', '.join(sorted(names))}"
                )
        found = tuple(task for task in tasks if self.count(task))
        if not found:
            raise BadInputError(f"no pose of {', '.join(map(str, tasks))} is trained")
        return found


@dataclass(frozen=True)
class TrainingBatch:
    """Scenes, perturbed poses and what the network should say of them.

    Poses are in groups of `BatchConfig.poses_per_sigma`, each of one scene, task and noise level:
    G = (sum of the tasks' poses a scene) / poses_per_sigma, plus N groups of negatives.

    Attributes:
        occupied: (B, r, r, r) voxels.
        X_VPs: (B, (G + N) * poses_per_sigma, 4, 4); the negatives come last.
        tasks: (G + N,) indices into the scenes' tasks, the same for all scenes.
        task_groups: how many of the G groups belong to each of the tasks that are trained.
        sigma: (B, G).
        target: (B, G, poses_per_sigma, 6) sigma * score.
        label: (B, G + N, poses_per_sigma) 1 for poses that the evaluator should accept, else 0.
    """

    occupied: Tensor
    X_VPs: Tensor
    tasks: Tensor
    task_groups: tuple[int, ...]
    sigma: Tensor
    target: Tensor
    label: Tensor


@dataclass(frozen=True)
class PerturbedPoses:
    """Poses (B, P) that noise has moved.

    Attributes:
        X_VPs: (B, P, 4, 4).
        sigma: (B, P / poses_per_sigma) noise levels.
        target: (B, P, 6) sigma * score.
        accepted: (B, P) whether they moved so little that the evaluator should accept them.
    """

    X_VPs: Tensor
    sigma: Tensor
    target: Tensor
    accepted: Tensor

    @classmethod
    def draw(
        cls, X_VPs: Tensor, batch: BatchConfig, split: SplitConfig, generator: torch.Generator
    ) -> "PerturbedPoses":
        """Perturb true poses (B, P, 4, 4)."""
        noise, per_sigma = split.noise, batch.poses_per_sigma
        shape = (len(X_VPs), X_VPs.shape[1] // per_sigma)
        sigma = noise.sigma(torch.rand(shape, generator=generator, device=generator.device))
        sigma_of_pose = sigma.repeat_interleave(per_sigma, 1)
        X_noisy = perturb(X_VPs, sigma_of_pose, noise.length_m, generator)
        # The target is that of the pose as it is, so poses may be kept inside the grid.
        X_noisy[..., :3, 3] = X_noisy[..., :3, 3].clamp(0.0, split.edge_m)
        target = target_score(X_VPs, X_noisy, sigma_of_pose, noise.length_m)
        moved = displacement(X_VPs, X_noisy, noise.length_m).square().mean(-1).sqrt()
        return cls(X_noisy, sigma, target, moved <= batch.evaluator_limit(noise))


def _true_poses(
    scenes: TrainingScenes, chosen: Tensor, batch: BatchConfig, generator: torch.Generator
) -> Tensor:
    """Return true poses (B, P, 4, 4) of the scenes `chosen` (B,), in the order of their tasks."""
    found = []
    for number, task in enumerate(scenes.tasks):
        X_VPs = scenes.true_poses(number, chosen, batch.count(task), generator)
        found.append(turned_alike(X_VPs, task.symmetry, generator))
    return torch.cat(found, 1)


def _false_poses(
    scenes: TrainingScenes, chosen: Tensor, batch: BatchConfig, generator: torch.Generator
) -> tuple[Tensor, list[int]]:
    """Return false poses (B, N, 4, 4), and whose they are: indices of tasks, each of as many."""
    owners = [number for number, poses in enumerate(scenes.poses) if poses.has_false]
    found = [scenes.X_VOs.new_empty((len(chosen), 0, 4, 4))]
    for number in owners:
        X_VPs = scenes.false_poses(number, chosen, batch.negatives, generator)
        found.append(turned_alike(X_VPs, scenes.tasks[number].symmetry, generator))
    return torch.cat(found, 1), owners


def draw_batch(
    scenes: TrainingScenes, batch: BatchConfig, split: SplitConfig, generator: torch.Generator
) -> TrainingBatch:
    """Return a random batch; `generator` is on the scenes' device and the only source of chance."""
    device, per_sigma = generator.device, batch.poses_per_sigma
    chosen = torch.randint(len(scenes), (batch.scenes,), generator=generator, device=device)
    augment = Similarity.draw(batch.scenes, batch.augmentation, split, generator)
    seen = misjudge_range(scenes.p_VSs[chosen], scenes.p_VCs[chosen], batch.augmentation, generator)
    points = add_noise(augment.points(seen), batch.augmentation, generator)
    X_VPs = augment.poses(_true_poses(scenes, chosen, batch, generator))
    perturbed = PerturbedPoses.draw(X_VPs, batch, split, generator)
    false, owners = _false_poses(scenes, chosen, batch, generator)
    negatives = augment.poses(false)
    label = torch.cat([perturbed.accepted, negatives.new_zeros(false.shape[:2]).bool()], 1)
    groups = [batch.count(task) // per_sigma for task in scenes.tasks]
    task_of_group = torch.tensor([*range(len(scenes.tasks)), *owners])
    all_groups = torch.tensor([*groups, *[batch.negatives // per_sigma] * len(owners)])
    return TrainingBatch(
        occupied=voxelize(points, split),
        X_VPs=torch.cat([perturbed.X_VPs, negatives], 1),
        tasks=task_of_group.repeat_interleave(all_groups).to(device),
        task_groups=tuple(count for count in groups if count),
        sigma=perturbed.sigma,
        target=perturbed.target.unflatten(1, (-1, per_sigma)),
        label=label.float().unflatten(1, (-1, per_sigma)),
    )
