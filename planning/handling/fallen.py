"""Whether an object that was let go above the table lies on it after all."""

import numpy as np

from planning.collision.distances import distance_to_segments, hook_capsules
from planning.execution.executor import Robot
from planning.handling.attempts import Perception
from planning.handling.held_view import apart_from, beside_robot
from planning.problem import Plan
from split_drake.objects_in_view import objects_in_view
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.sensing.table_noise import above_table_noise
from split_drake.station.layout import Layout

# What is lower is not looked at: the table's own noise, far from a camera.
_FLOOR_M = 0.02
# What hangs, or stands on a shelf, stays this far above what is looked at.
_BELOW_GOAL_M = 0.04
# What has fallen shows this many points at least: a mug far from the cameras shows 2000.
_LEAST_POINTS = 300
_HOOK_MARGIN_M = 0.02


def fallen_object(robot: Robot, layout: Layout, plan: Plan, perception: Perception) -> Array | None:
    """Return the middle (3,) in W of what a look finds on the table, None where nothing is new.

    Where the object's goal is not well above the table nothing can be told, and None is returned.

    Args:
        robot: that let the object go.
        layout: of the static station.
        plan: of the pick, from where the object lay.
        perception: that it was made from.
    """
    views = robot.capture()
    clearance_m = above_table_noise(layout.workspace, views).table_clearance_m
    floor_m = layout.table_z_m + max(_FLOOR_M, clearance_m)
    at_goal = transform_points(plan.X_WGoal @ invert_pose(plan.X_WObject), perception.p_WPs)
    ceiling_m = at_goal[:, 2].min() - _BELOW_GOAL_M
    if ceiling_m < floor_m + _BELOW_GOAL_M:
        return None
    opening_m = float(np.clip(robot.opening_m, 0.0, MAX_OPENING_M))
    seen = beside_robot(views, robot.q, opening_m, floor_m)
    on_table = np.abs(seen[:, :2] - layout.p_WTable) < np.divide(layout.table_size_m[:2], 2.0)
    seen = seen[on_table.all(axis=1) & (seen[:, 2] < ceiling_m)]
    seen = apart_from(seen, _stood_there(perception, floor_m))
    for capsule in hook_capsules(layout):
        gaps_m = distance_to_segments(seen, *capsule.p_FEnds) - capsule.radius_m
        seen = seen[gaps_m > _HOOK_MARGIN_M]
    found = objects_in_view(seen)
    if not found or len(found[0].p_WPs) < _LEAST_POINTS:
        return None
    return np.asarray(found[0].p_WPs.mean(axis=0))


def _stood_there(perception: Perception, floor_m: float) -> Array:
    """Return all points (N, 3) that were seen higher than that, but for those of the object."""
    shown = [view.points(floor_m) for view in perception.scene.views]
    return apart_from(np.concatenate([perception.p_WObstacles, *shown]), perception.p_WPs)
