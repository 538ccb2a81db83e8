"""Labelled scenes, drawn and kept."""
