"""Detectors of trials, a file each."""
