"""The Panda hand as boxes in the gripper frame G, shared by labels, planner and robot model.

G: origin between the centres of the finger pads, z approach, y closing direction.  X_WG and
X_WG Rot_z(pi) are the same grasp.
"""

from dataclasses import dataclass

import numpy as np

from split_drake.poses import Array

MAX_OPENING_M = 0.08
MAX_FORCE_N = 40.0

# Distance along z from the hand's frame (panda_hand) to G, and from the flange to the hand's frame.
HAND_TO_GRIPPER_M = 0.1034
FLANGE_TO_GRIPPER_M = 0.107 + HAND_TO_GRIPPER_M

# The pads' extent along x and z of G, and their thickness along y.
PAD_SIZE_M = (0.020, 0.022)
PAD_THICKNESS_M = 0.014


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in G: lower and upper corner, metres."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    @property
    def size(self) -> Array:
        return np.subtract(self.upper, self.lower)

    @property
    def center(self) -> Array:
        return np.add(self.upper, self.lower) / 2.0


PALM = Box((-0.025, -0.100, -0.1284), (0.025, 0.100, -0.0384))


def finger_boxes(opening_m: float) -> tuple[Box, ...]:
    """Return pad and stem of both fingers, held `opening_m` apart (0 to MAX_OPENING_M)."""
    if not 0.0 <= opening_m <= MAX_OPENING_M + 1e-9:
        raise ValueError(f"opening_m is {opening_m}; expected 0 to {MAX_OPENING_M}")
    near, half_x, half_z = opening_m / 2.0, PAD_SIZE_M[0] / 2.0, PAD_SIZE_M[1] / 2.0
    far = near + PAD_THICKNESS_M
    return (
        Box((-half_x, near, -half_z), (half_x, far, half_z)),
        Box((-half_x, -far, -half_z), (half_x, -near, half_z)),
        Box((-0.009, near + 0.008, -0.045), (0.009, near + 0.022, -half_z)),
        Box((-0.009, -near - 0.022, -0.045), (0.009, -near - 0.008, -half_z)),
    )


def gripper_boxes(opening_m: float) -> tuple[Box, ...]:
    """Return palm, pads and stems of a hand whose pads are `opening_m` apart."""
    return (PALM, *finger_boxes(opening_m))
