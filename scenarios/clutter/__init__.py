"""The parts of clutter removal."""
