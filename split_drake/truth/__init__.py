"""The simulator's true state, which nothing outside this room reads."""
