"""The planner `gcs`: picks and places as the default one, motions through shipped regions."""

from planning.motion.gcs import GcsMotion
from planning.motion.regions import load_regions
from planning.pick_place.search import PickPlacePlanner
from planning.planner import Planner, register_planner


@register_planner("gcs")
def gcs_planner() -> Planner:
    """Return a planner for the station that `models/regions` was grown in."""
    return PickPlacePlanner(GcsMotion(load_regions()))
