"""Timed motions of the arm from one configuration to another."""
