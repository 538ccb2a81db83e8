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


@dataclass(frozen=True)
class MotionQuery:
    """Two configurations to be joined.

    Attributes:
        world: that the arm moves in.
        q_start, q_goal: (7,) joint angles, rad.
        situation: what the hand holds and what stands around it.
    """

    world: CollisionWorld
    q_start: Array
    q_goal: Array
    situation: Situation

    def is_free(self, qs: Array) -> bool:
        """Return whether the straight joint motions through `qs` (N, 7) touch nothing."""
        return self.world.path_free(qs, self.situation)


class FreeMotion(Protocol):
    """Joins two configurations: what planners that pick and place alike may differ in."""

    def __call__(self, query: MotionQuery, rng: np.random.Generator) -> Array | NoMotion:
        """Return a path (N, 7) from start to goal, rad, that is free throughout."""
        ...


def free_motion(query: MotionQuery, rng: np.random.Generator) -> Array | NoMotion:
    """Return a path (N, 7) that is free throughout, or why there is none.

    A straight joint motion where that is free; else RRT-Connect's path, smoothed by trajectory
    optimization where the smooth one is free as well.
    """
    straight = np.stack([query.q_start, query.q_goal])
    if query.is_free(straight):
        return straight
    found = rrt_motion(query, rng)
    if isinstance(found, NoMotion):
        return found
    smooth = optimize_path(query.world.checker, found, query.situation.opening_m)
    if smooth is not None and query.is_free(smooth):
        return smooth
    return found


def rrt_motion(query: MotionQuery, rng: np.random.Generator) -> Array | NoMotion:
    """Return RRT-Connect's path (N, 7) with shortcuts, or that there is none."""
    found = rrt_connect(query.q_start, query.q_goal, query.is_free, rng)
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
