"""Motions between a start and a goal pose, among boxes and cylinders: problems, files and runs."""
