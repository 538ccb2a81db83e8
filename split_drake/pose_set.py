"""Pose sets: what a detector returns and a planner takes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from split_drake.files import replacing
from split_drake.pose_task import PoseTask
from split_drake.poses import Array, check_poses

if TYPE_CHECKING:
    from split_drake.scene import Scene


@dataclass(frozen=True)
class PoseSet:
    """Poses for one task in one scene, best first.

    Attributes:
        task: what the poses are for.
        X_WPs: (N, 4, 4) poses in the world, N >= 0.
        scores: (N,) in [0, 1], descending.  They rank poses and are no probabilities; true handle
            and upright poses all have 1.
    """

    task: PoseTask
    X_WPs: Array
    scores: Array

    def __post_init__(self) -> None:
        poses = check_poses(np.reshape(self.X_WPs, (-1, 4, 4)), f"X_WPs of {self.task}")
        scores = np.asarray(self.scores, dtype=float)
        if scores.shape != (len(poses),):
            raise ValueError(f"scores have shape {scores.shape}; expected ({len(poses)},)")
        if not np.all((scores >= 0.0) & (scores <= 1.0)):
            wrong = scores[~((scores >= 0.0) & (scores <= 1.0))][0]
            raise ValueError(f"a score of {self.task} is {wrong}; expected [0, 1]")
        if np.any(np.diff(scores) > 0.0):
            at = int(np.argmax(np.diff(scores) > 0.0))
            raise ValueError(
                f"scores of {self.task} do not descend: {scores[at]:.4f} is followed by "
                f"{scores[at + 1]:.4f}; use PoseSet.ranked"
            )
        object.__setattr__(self, "task", PoseTask(self.task))
        object.__setattr__(self, "X_WPs", poses)
        object.__setattr__(self, "scores", scores)

    @classmethod
    def ranked(cls, task: PoseTask, X_WPs: Array, scores: Array) -> Self:
        """Return the set with its poses sorted, best first."""
        order = np.argsort(-np.asarray(scores), kind="stable")
        return cls(task, np.asarray(X_WPs)[order], np.asarray(scores)[order])

    def __len__(self) -> int:
        return len(self.scores)

    def head(self, count: int) -> Self:
        """Return the best `count` poses (all of them where there are fewer)."""
        return type(self)(self.task, self.X_WPs[:count], self.scores[:count])

    def subset(self, kept: NDArray[np.bool_]) -> Self:
        """Return the poses that `kept` (N,) marks."""
        return type(self)(self.task, self.X_WPs[kept], self.scores[kept])

    def moved(self, X_WMoved: Array) -> Self:
        """Return the set after everything has moved by X_WMoved (4, 4), given in W."""
        return type(self)(self.task, X_WMoved @ self.X_WPs, self.scores)


class PoseDetector(Protocol):
    """Finds poses in a scene: SPLIT, the oracle, or a baseline."""

    def detect(
        self, scene: "Scene", tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, PoseSet]:
        """Return one pose set for each of `tasks`; empty where nothing was found."""
        ...


def save_pose_sets(path: Path, pose_sets: dict[PoseTask, PoseSet], p_WPs: Array) -> None:
    """Write pose sets and the cloud `p_WPs` (N, 3) they were found in to an npz, atomically."""
    arrays: dict[str, np.ndarray] = {"cloud": np.asarray(p_WPs, dtype=np.float32)}
    for task, pose_set in pose_sets.items():
        arrays[f"{task}/X_WPs"] = pose_set.X_WPs
        arrays[f"{task}/scores"] = pose_set.scores
    with replacing(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)


def load_pose_sets(path: Path) -> tuple[dict[PoseTask, PoseSet], Array]:
    """Return ({task: PoseSet}, cloud (N, 3)) as written by `save_pose_sets`.

    Raises ValueError where the file is no pose-set archive.
    """
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    if "cloud" not in arrays:
        raise ValueError(f"{path} holds {sorted(arrays)}; expected 'cloud' and '<task>/X_WPs'")
    sets = {
        task: PoseSet(task, arrays[f"{task}/X_WPs"], arrays[f"{task}/scores"])
        for task in PoseTask
        if f"{task}/X_WPs" in arrays
    }
    return sets, arrays["cloud"].astype(float)
