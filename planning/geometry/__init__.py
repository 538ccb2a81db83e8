"""Pose algebra and what is known of the perceived object."""
