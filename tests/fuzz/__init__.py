"""Inputs that nobody would give on purpose."""
