"""The planner `rrt`: picks and places as the default one, every motion by RRT-Connect alone."""

from planning.motion.free import rrt_motion
from planning.pick_place.search import PickPlacePlanner
from planning.planner import Planner, register_planner


@register_planner("rrt")
def rrt_planner() -> Planner:
    """Return a planner without straight shortcuts to the goal and trajectory optimization."""
    return PickPlacePlanner(rrt_motion)
