"""Mugs drawn from parameters."""
