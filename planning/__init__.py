"""Pose sets in, plans out, and their execution.

Knows pose sets, the perceived cloud and the static layout; never the detector's model nor the
simulator's state.
"""
