"""What lies so far off that no search is needed to tell that the arm cannot take it."""

from dataclasses import replace

import numpy as np

from planning.problem import PlanFailure, PlanningProblem, Stage
from split_drake.pose_task import GRASP
from split_drake.robot.kinematics import REACH_M, shoulder_distances

# An object that is taken by one end has its frames no further from the hand than this.
OBJECT_M = 0.3


def within_reach(problem: PlanningProblem) -> PlanningProblem | PlanFailure:
    """Return the problem without poses that are out of the arm's reach.

    A failure that says how far off they are where none is left of the grasps, or of the poses that
    are to be placed.
    """
    sets = dict(problem.pose_sets)
    for name, poses in problem.pose_sets.items():
        limit_m = REACH_M + OBJECT_M
        distances = shoulder_distances(poses.X_WPs[:, :3, 3])
        near = distances <= limit_m
        if near.all():
            continue
        sets[name] = poses.subset(near)
        if not near.any() and name in (GRASP.name, problem.subgoal.task.name):
            return PlanFailure(
                Stage.PLANNING,
                f"all {len(poses)} {name} poses are out of the arm's reach: the nearest is "
                f"{np.min(distances):.2f} m from its shoulder, and the arm reaches {REACH_M:.2f} m",
            )
    return replace(problem, pose_sets=sets)
