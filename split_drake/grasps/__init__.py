"""Grasps of an object, sampled, judged, and tried in a free hand."""
