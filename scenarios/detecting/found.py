"""What a detector finds in a scene, object by object."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from split_drake.objects_in_view import scenes_of_objects
from split_drake.pose_set import PoseDetector, PoseSets
from split_drake.poses import Array
from split_drake.scene import Scene


@dataclass(frozen=True)
class FoundObject:
    """One object in view, and its pose sets.

    Attributes:
        p_WPs: (N, 3) its points, metres in W.
        pose_sets: by their tasks' names.
    """

    p_WPs: Array
    pose_sets: PoseSets

    @property
    def p_WMiddle(self) -> Array:
        """The median of its points along each axis of W, (3,) in metres."""
        return np.asarray(np.median(self.p_WPs, axis=0))

    def fields(self) -> dict[str, Any]:
        """Return the object as values that JSON has."""
        return {
            "points": len(self.p_WPs),
            "p_WMiddle": self.p_WMiddle.round(4).tolist(),
            "pose_sets": {
                name: {
                    "frame": poses.task.frame,
                    "reason": poses.reason,
                    "scores": poses.scores.tolist(),
                    "X_WPs": poses.X_WPs.tolist(),
                }
                for name, poses in self.pose_sets.items()
            },
        }


def find_poses(
    scene: Scene, detector: PoseDetector, tasks: Sequence[str], rng: np.random.Generator
) -> list[FoundObject]:
    """Return what is found of each object in view, that with the most points first."""
    return [
        FoundObject(each.p_WPs, detector.detect(each, tasks, rng))
        for each in scenes_of_objects(scene)
    ]
