"""Labelled scenes of clutter, seen from one side."""
