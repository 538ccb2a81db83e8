"""Where the objects of a subgoal must end, a file for each subgoal."""
