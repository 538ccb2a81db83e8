"""A planner whose free motions are straight, or have one bend at a random configuration."""

import numpy as np

from planning.motion.free import MotionQuery, NoMotion
from planning.pick_place.search import PickPlacePlanner
from planning.planner import Planner, register_planner
from split_drake.poses import Array
from split_drake.robot.panda import arm_limits

TRIES = 200


def one_bend(query: MotionQuery, rng: np.random.Generator) -> Array | NoMotion:
    """Return a path (2 or 3, 7) from start to goal, joint angles in rad, or why there is none."""
    straight = np.stack([query.q_start, query.q_goal])
    if query.is_free(straight):
        return straight
    limits = arm_limits()
    for _ in range(TRIES):
        middle = straight.mean(axis=0) + rng.normal(0.0, 0.7, size=7)
        bend = np.clip(middle, limits.q_lower + 0.02, limits.q_upper - 0.02)
        path = np.stack([query.q_start, bend, query.q_goal])
        if query.is_free(path):
            return path
    return NoMotion(f"no free motion with one bend in {TRIES} tries")


@register_planner("one-bend")
def one_bend_planner() -> Planner:
    """Return a planner that picks and places as the default one does."""
    return PickPlacePlanner(one_bend)
