"""Collision-free motions between configurations, and their timing."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from planning.collision.world import CollisionWorld, Situation
from planning.motion.rrt import rrt_connect
from planning.motion.timing import Speed, join, time_path
from planning.motion.trajopt import optimize_path
from planning.problem import JointTrajectory
from split_drake.poses import Array


@dataclass(frozen=True)
class NoMotion:
    """No path between two configurations, and why."""

    reason: str


class FreeMotion(Protocol):
    """Joins two configurations: what planners that pick and place alike may differ in."""

    def __call__(
        self,
        world: CollisionWorld,
        q_start: Array,
        q_goal: Array,
        situation: Situation,
        rng: np.random.Generator,
    ) -> Array | NoMotion:
        """Return a path (N, 7) from `q_start` to `q_goal`, rad, that is free throughout."""
        ...


def free_motion(
    world: CollisionWorld,
    q_start: Array,
    q_goal: Array,
    situation: Situation,
    rng: np.random.Generator,
) -> Array | NoMotion:
    """Return a path (N, 7) that is free throughout, or why there is none.

    A straight joint motion where that is free; else RRT-Connect's path, smoothed by trajectory
    optimization where the smooth one is free as well.
    """
    straight = np.stack([q_start, q_goal])
    if world.path_free(straight, situation):
        return straight
    found = rrt_motion(world, q_start, q_goal, situation, rng)
    if isinstance(found, NoMotion):
        return found
    smooth = optimize_path(world.checker, found, situation.opening_m)
    if smooth is not None and world.path_free(smooth, situation):
        return smooth
    return found


def rrt_motion(
    world: CollisionWorld,
    q_start: Array,
    q_goal: Array,
    situation: Situation,
    rng: np.random.Generator,
) -> Array | NoMotion:
    """Return RRT-Connect's path (N, 7) with shortcuts, or that there is none."""
    found = rrt_connect(q_start, q_goal, lambda qs: world.path_free(qs, situation), rng)
    return NoMotion("RRT-Connect found no free motion") if found is None else found


def timed(world: CollisionWorld, qs: Array, situation: Situation, speed: Speed) -> JointTrajectory:
    """Return a free path (N, 7) with its timing.

    Interpolation rounds the corners of a path; where that touches something, the arm stops at
    every corner instead.
    """
    trajectory = time_path(qs, speed)
    if len(qs) == 2 or world.path_free(trajectory.qs, situation):
        return trajectory
    return join([time_path(qs[i : i + 2], speed) for i in range(len(qs) - 1)])
