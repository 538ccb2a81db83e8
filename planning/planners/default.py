"""The planner `default`: pick and place, with smoothed motions."""

from planning.pick_place.search import PickPlacePlanner
from planning.planner import Planner, register_planner


@register_planner("default")
def default_planner() -> Planner:
    """Return a planner that joins the lines of pick and place by free motions, smoothed."""
    return PickPlacePlanner()
