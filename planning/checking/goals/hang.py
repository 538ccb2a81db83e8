"""Where plans to hang must end: a handle around the peg of the hook."""

import numpy as np

from planning.checking.goal_checks import GoalCheck
from planning.collision.exemptions import MAX_LOWERING_M
from planning.problem import Plan, PlanningProblem
from split_drake.poses import invert_pose

# Where the frame of a hung object may end, seen from K: across the peg, above and below it, short
# of its tip, and how far turned.
ACROSS_PEG_M, ABOVE_PEG_M, BELOW_PEG_M = 0.01, 0.01, MAX_LOWERING_M + 0.01
SHORT_OF_TIP_M, ON_PEG_RAD = 0.01, np.radians(10.0)


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


GOAL_CHECK = GoalCheck(subgoal="hang", off_goal=off_peg)
