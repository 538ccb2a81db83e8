"""The Panda: its model in a plant, its hand, limits, kinematics and commands."""
