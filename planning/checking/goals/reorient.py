"""Where plans to reorient must end: an object that stands on the table."""

import numpy as np

from planning.checking.goal_checks import GoalCheck
from planning.collision.exemptions import MAX_TABLE_DEPTH_M
from planning.problem import Plan, PlanningProblem
from split_drake.poses import invert_pose, transform_points

# How high above the table the lowest seen point of an upright object may end, and how far its axis
# may tilt.
LOWEST_M, ON_TABLE_RAD = (-MAX_TABLE_DEPTH_M - 0.004, 0.05), np.radians(5.0)


def off_table(plan: Plan, problem: PlanningProblem) -> str:
    """Return how an object ends that does not stand, or an empty string."""
    tilt_rad = float(np.arccos(np.clip(plan.X_WGoal[2, 2], -1.0, 1.0)))
    p_OPs = transform_points(invert_pose(plan.X_WObject), problem.p_WPs)
    lowest_z_m = float(transform_points(plan.X_WGoal, p_OPs)[:, 2].min())
    lowest_m = lowest_z_m - problem.layout.table_z_m
    if tilt_rad <= ON_TABLE_RAD and LOWEST_M[0] <= lowest_m <= LOWEST_M[1]:
        return ""
    return f"{1e3 * lowest_m:.0f} mm above the table, tilted by {np.degrees(tilt_rad):.0f} deg"


GOAL_CHECK = GoalCheck(subgoal="reorient", off_goal=off_table)
