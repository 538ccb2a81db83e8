"""How good a detector's poses are, measured without a robot."""
