"""Which of several objects in view a subgoal is for, and what of the rest is in the way."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planning.geometry.perceived import OBSTACLE_VOXEL_M, voxel_centroids
from split_drake.objects_in_view import objects_in_view, owners
from split_drake.pose_set import PoseSet, PoseSets
from split_drake.pose_task import PoseTask
from split_drake.poses import Array


@dataclass(frozen=True)
class Focus:
    """One object of those in view.

    Attributes:
        pose_sets: its own poses, by their tasks' names.
        p_WPs: (N, 3) its points, metres in W.
        p_WObstacles: (O, 3) those of all else.
        in_view: how many objects there are.
    """

    pose_sets: Mapping[str, PoseSet]
    p_WPs: Array
    p_WObstacles: Array
    in_view: int


def focus_on_one(p_WPs: Array, pose_sets: PoseSets, tasks: Sequence[PoseTask]) -> Focus:
    """Return the object whose poses promise most, with the poses that belong to it alone.

    That is the one with poses of most of the tasks, and of those the one with the largest product
    of its best scores.

    Args:
        p_WPs: (N, 3) cloud of all that is in view.
        pose_sets: found there.
        tasks: that poses are needed of.
    """
    objects = objects_in_view(p_WPs)
    if len(objects) < 2:
        return Focus(dict(pose_sets), p_WPs, np.empty((0, 3)), len(objects))
    owned = {name: owners(poses.X_WPs, objects) for name, poses in pose_sets.items()}
    sets = [
        {name: poses.subset(owned[name] == index) for name, poses in pose_sets.items()}
        for index in range(len(objects))
    ]
    best = max(range(len(objects)), key=lambda index: _promise(sets[index], tasks))
    own = objects[best].points
    return Focus(sets[best], p_WPs[own], p_WPs[~own], len(objects))


def _promise(pose_sets: PoseSets, tasks: Sequence[PoseTask]) -> tuple[int, float]:
    """Return of how many tasks there are poses, and the product of their best scores."""
    found = [pose_sets[task.name] for task in tasks if len(pose_sets.get(task.name, ()))]
    return len(found), float(np.prod([poses.scores[0] for poses in found]))


def filled_down(p_WPs: Array, floor_z_m: float) -> Array:
    """Return coarse points (M, 3) of things that stand on a floor, solid below what is seen.

    The sides that no camera shows are so kept clear of, too.

    Args:
        p_WPs: (N, 3) points that are seen.
        floor_z_m: height of the floor in W.
    """
    seen = voxel_centroids(np.asarray(p_WPs, dtype=float), OBSTACLE_VOXEL_M)
    if not len(seen):
        return seen
    columns = [
        np.column_stack([np.full((len(z), 2), point[:2]), z])
        for point in seen
        if len(z := np.arange(point[2], floor_z_m, -OBSTACLE_VOXEL_M))
    ]
    return voxel_centroids(np.concatenate([seen, *columns]), OBSTACLE_VOXEL_M)
