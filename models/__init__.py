"""Robot, hook and mug models, and the weights that ship with the project."""
