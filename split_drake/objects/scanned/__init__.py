"""Mugs measured from mesh files."""
