"""Where the object of a subgoal must end: the judge's own tests, apart from what makes placements.

A subgoal that is defined elsewhere registers its test by `register_goal_check`.
"""

from collections.abc import Callable

import numpy as np

from planning.collision.exemptions import MAX_LOWERING_M, MAX_TABLE_DEPTH_M
from planning.problem import Plan, PlanningProblem
from split_drake.poses import invert_pose, transform_points

# Says where a plan brings the object that is not what the problem asks for; "" where it is.
GoalCheck = Callable[[Plan, PlanningProblem], str]

# Where the frame of a hung object may end, seen from K: across the peg, above and below it, short
# of its tip, and how far turned.
ACROSS_PEG_M, ABOVE_PEG_M, BELOW_PEG_M = 0.01, 0.01, MAX_LOWERING_M + 0.01
SHORT_OF_TIP_M, ON_PEG_RAD = 0.01, np.radians(10.0)
# How high the lowest seen point of an upright object may end, and how far its axis may tilt.
LOWEST_M, ON_TABLE_RAD = (-MAX_TABLE_DEPTH_M - 0.004, 0.05), np.radians(5.0)


def off_peg(plan: Plan, problem: PlanningProblem) -> str:
    """Return where a handle ends that is not around the peg, or an empty string."""
    layout = problem.layout
    X_KH = invert_pose(layout.X_WK) @ plan.X_WGoal
    x_m, y_m, z_m = (float(value) for value in X_KH[:3, 3])
    angle_rad = float(np.arccos(min(1.0, abs(X_KH[1, 1]))))
    root_m = -(layout.hook.post_distance_m - layout.hook.post_radius_m)
    on_peg = root_m < y_m < layout.hook.tip_distance_m - SHORT_OF_TIP_M
    around = abs(x_m) <= ACROSS_PEG_M and -BELOW_PEG_M <= z_m <= ABOVE_PEG_M
    if on_peg and around and angle_rad <= ON_PEG_RAD:
        return ""
    p_KH = ", ".join(str(round(1e3 * value)) for value in (x_m, y_m, z_m))
    return f"p_KH = ({p_KH}) mm, {np.degrees(angle_rad):.1f} deg off the peg's axis"


def off_table(plan: Plan, problem: PlanningProblem) -> str:
    """Return how an object ends that does not stand, or an empty string."""
    tilt_rad = float(np.arccos(np.clip(plan.X_WGoal[2, 2], -1.0, 1.0)))
    p_OPs = transform_points(invert_pose(plan.X_WObject), problem.p_WPs)
    lowest_m = float(transform_points(plan.X_WGoal, p_OPs)[:, 2].min())
    if tilt_rad <= ON_TABLE_RAD and LOWEST_M[0] <= lowest_m <= LOWEST_M[1]:
        return ""
    return f"{1e3 * lowest_m:.0f} mm above the table, tilted by {np.degrees(tilt_rad):.0f} deg"


_CHECKS: dict[str, GoalCheck] = {"hang": off_peg, "reorient": off_table}


def register_goal_check(subgoal: str, check: GoalCheck) -> None:
    """Say where the objects of a subgoal must end; raise ValueError where that is said already."""
    if subgoal in _CHECKS:
        raise ValueError(f"there is a check of where plans to {subgoal} end already")
    _CHECKS[subgoal] = check


def goal_check(subgoal: str) -> GoalCheck:
    """Return the check of a subgoal's ends, or raise ValueError naming those there are."""
    if subgoal not in _CHECKS:
        raise ValueError(
            f"nothing says where plans to {subgoal} must end, only those to "
            f"{', '.join(sorted(_CHECKS))}; register_goal_check says it"
        )
    return _CHECKS[subgoal]
