"""Where a subgoal takes an object."""
