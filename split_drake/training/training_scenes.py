"""A data set as tensors on one device, from which scenes and their true poses are drawn."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import torch
from torch import Tensor

from split_drake.bad_input import BadInputError
from split_drake.data.dataset import TaskLabels
from split_drake.data.labels import PoseState
from split_drake.pose_task import PoseTask, UnknownTaskError
from split_drake.scene import Workspace


class LabelledScenes(Protocol):
    """What a data set offers for S scenes of M objects, in W."""

    @property
    def clouds(self) -> np.ndarray:
        """(S, 2000, 3) points without noise."""

    @property
    def X_WOs(self) -> np.ndarray:
        """(S, 4, 4) poses of the subjects."""

    @property
    def p_WCs(self) -> np.ndarray:
        """(S, 3) where cameras stand."""

    @property
    def object_index(self) -> np.ndarray:
        """(S,) which object each scene shows."""

    @property
    def labels(self) -> Mapping[str, TaskLabels]:
        """{name of a task: its labelled poses}."""

    @property
    def workspace(self) -> Workspace:
        """The cube that the scenes were cropped to."""


@dataclass(frozen=True)
class TaskPoses:
    """The labelled poses of one task as tensors, in their objects' frames.

    Attributes:
        X_OPs: (M, L, 4, 4).
        weights: (M, L) how likely a true pose is to be drawn, relative to the others.
        states: (S, L) uint8.
        has_false: whether some of them are false.
    """

    X_OPs: Tensor
    weights: Tensor
    states: Tensor
    has_false: bool

    @classmethod
    def of(cls, labels: TaskLabels, device: torch.device) -> Self:
        """Return the labels on a device."""
        return cls(
            X_OPs=torch.tensor(labels.X_OPs, dtype=torch.float32, device=device),
            weights=torch.tensor(labels.weights, dtype=torch.float32, device=device),
            states=torch.tensor(labels.states, dtype=torch.uint8, device=device),
            has_false=bool((labels.states == PoseState.FALSE).any()),
        )


@dataclass(frozen=True)
class TrainingScenes:
    """Scenes relative to the workspace's corner V.

    Poses stay in their object's frame until they are drawn, so that 30,000 scenes take 0.8 GB.

    Attributes:
        p_VSs: (S, 2000, 3) points.
        p_VCs: (S, 3) cameras.
        X_VOs: (S, 4, 4).
        object_index: (S,).
        tasks: that are trained, T of them.
        poses: of each of the tasks.
    """

    p_VSs: Tensor
    p_VCs: Tensor
    X_VOs: Tensor
    object_index: Tensor
    tasks: tuple[PoseTask, ...]
    poses: tuple[TaskPoses, ...]

    @classmethod
    def of(cls, dataset: LabelledScenes, tasks: Sequence[PoseTask], device: torch.device) -> Self:
        """Return the scenes of a data set with the labels of some of its tasks.

        Raises UnknownTaskError where the data set has no labels of a task; ValueError where a scene
        has no true pose of one, or of one that has false poses no false one.
        """
        for task in tasks:
            _require_drawable(dataset, task)
        offset = torch.tensor(dataset.workspace.p_WV, dtype=torch.float32, device=device)
        X_VOs = torch.tensor(dataset.X_WOs, dtype=torch.float32, device=device)
        X_VOs[..., :3, 3] -= offset
        clouds = torch.tensor(dataset.clouds, dtype=torch.float32, device=device)
        return cls(
            p_VSs=clouds.sub_(offset),
            p_VCs=torch.tensor(dataset.p_WCs, dtype=torch.float32, device=device) - offset,
            X_VOs=X_VOs,
            object_index=torch.tensor(dataset.object_index, dtype=torch.long, device=device),
            tasks=tuple(tasks),
            poses=tuple(TaskPoses.of(dataset.labels[task.name], device) for task in tasks),
        )

    def __len__(self) -> int:
        return len(self.p_VSs)

    def share(self) -> None:
        """Move the scenes to memory that processes share, so that there is one copy for all.

        Raises MemoryError where there is not enough of it; on Linux it is that of /dev/shm.
        """
        of_tasks = [
            tensor for task in self.poses for tensor in (task.X_OPs, task.weights, task.states)
        ]
        tensors = (self.p_VSs, self.p_VCs, self.X_VOs, self.object_index, *of_tasks)
        try:
            for tensor in tensors:
                tensor.share_memory_()
        except RuntimeError as error:
            needed_gb = sum(tensor.nbytes for tensor in tensors) / 1e9
            raise MemoryError(
                f"scenes of {needed_gb:.2f} GB do not fit into the memory that processes share, "
                f"/dev/shm on Linux; train with one process, or make it larger ({error})"
            ) from error

    def true_poses(
        self, task: int, chosen: Tensor, count: int, generator: torch.Generator
    ) -> Tensor:
        """Return poses (B, count, 4, 4) in V of scenes (B,), in proportion to their weights.

        `task` is an index into `tasks`.
        """
        poses = self.poses[task]
        true = poses.states[chosen] == PoseState.TRUE
        weights = poses.weights[self.object_index[chosen]] * true
        return self._draw(poses, chosen, weights, count, generator)

    def false_poses(
        self, task: int, chosen: Tensor, count: int, generator: torch.Generator
    ) -> Tensor:
        """Return poses (B, count, 4, 4) in V that are false, at least in those scenes (B,)."""
        poses = self.poses[task]
        weights = (poses.states[chosen] == PoseState.FALSE).float()
        return self._draw(poses, chosen, weights, count, generator)

    def _draw(
        self,
        poses: TaskPoses,
        chosen: Tensor,
        weights: Tensor,
        count: int,
        generator: torch.Generator,
    ) -> Tensor:
        """Return poses (B, count, 4, 4) in V, drawn with probabilities ~ weights (B, L)."""
        if count == 0:  # which torch.multinomial refuses
            return poses.X_OPs.new_empty((len(chosen), 0, 4, 4))
        drawn = torch.multinomial(weights, count, replacement=True, generator=generator)
        X_OPs = poses.X_OPs[self.object_index[chosen][:, None], drawn]
        return self.X_VOs[chosen][:, None] @ X_OPs


def _require_drawable(dataset: LabelledScenes, task: PoseTask) -> None:
    """Raise ValueError naming a scene without a true, or without a false pose of a task."""
    if task.name not in dataset.labels:
        known = ", ".join(dataset.labels)
        raise UnknownTaskError(
            f"the dataset has no labels of {task.name!r}; it has those of {known}"
        )
    labels = dataset.labels[task.name]
    true = (labels.states == PoseState.TRUE) & (labels.weights[dataset.object_index] > 0.0)
    false = labels.states == PoseState.FALSE
    wanted = [(true, f"true {task} pose of positive weight")]
    if false.any():
        wanted.append((false, f"false {task} pose"))
    for states, kind in wanted:
        if len(missing := np.flatnonzero(~states.any(axis=1))):
            raise BadInputError(
                f"{len(missing)} of {len(states)} scenes, {missing[0]} the first, have no {kind}; "
                "expected at least one in each"
            )
