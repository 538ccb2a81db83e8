"""A second look at the best grasps: depth images at their full resolution, from the hand's view."""
