"""Poses with errors added, to see what a pipeline bears: noise of a known size on a detector's."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from split_drake.bad_input import require_numbers
from split_drake.pose_set import PoseDetector, PoseSet
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene


@dataclass(frozen=True)
class PoseNoise:
    """Gaussian errors of poses, each independent of the others.

    Attributes:
        shift_m: standard deviation of the position along each axis.
        turn_rad: standard deviation of the turn about each axis, through the pose's own origin.

    Raises ValueError where one of them is negative or not finite.
    """

    shift_m: float = 0.0
    turn_rad: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("shift_m", "turn_rad"):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise ValueError(f"{name} of the pose noise is {value}; expected 0 or more")

    def __bool__(self) -> bool:
        return self.shift_m > 0.0 or self.turn_rad > 0.0

    def added_to(self, poses: PoseSet, rng: np.random.Generator) -> PoseSet:
        """Return the set with errors drawn for every pose; scores stay as they are."""
        shifts_m, turns_rad = rng.normal(size=(2, len(poses), 3))
        X_WPs = poses.X_WPs.copy()
        X_WPs[:, :3, 3] += self.shift_m * shifts_m
        R_Ws = Rotation.from_rotvec(self.turn_rad * turns_rad).as_matrix()
        X_WPs[:, :3, :3] = R_Ws @ X_WPs[:, :3, :3]
        return PoseSet(poses.task, X_WPs, poses.scores)


@dataclass(frozen=True)
class NoisyDetector:
    """A detector whose poses are off; a PoseDetector.

    Attributes:
        detector: that finds the poses.
        noise: added to each of them, drawn from the generator that `detector` draws from.
    """

    detector: PoseDetector
    noise: PoseNoise

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return a pose set for each of `tasks`, by their names."""
        found = self.detector.detect(scene, tasks, rng)
        return {task: self.noise.added_to(poses, rng) for task, poses in found.items()}
