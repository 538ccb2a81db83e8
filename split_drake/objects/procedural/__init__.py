"""Shapes of many kinds drawn from parameters."""
