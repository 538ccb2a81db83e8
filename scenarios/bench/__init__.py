"""The parts of the planner bench."""
