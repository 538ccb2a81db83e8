"""Planners, a file each."""
