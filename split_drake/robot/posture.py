"""Where the arm rests."""

import numpy as np

from split_drake.poses import Array

# The hand hangs over the table between the base and the workspace, behind every line of sight from
# the cameras of `layout.two_views` to the workspace.
Q_HOME: Array = np.array([0.0, -0.9, 0.0, -2.5, 0.0, 1.6, np.pi / 4])
Q_HOME.setflags(write=False)
# Of the Panda's joints, rad (Franka Emika, "Robot and interface specifications").
LOWEST_Q = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
HIGHEST_Q = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
