"""Meshes of any kind: read from files, weighed, and cut into convex pieces."""
