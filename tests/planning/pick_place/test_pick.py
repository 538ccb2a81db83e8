"""How an object that is in the hand already is to be let go."""

import numpy as np
import pytest

from planning.geometry.perceived import PerceivedObject
from planning.pick_place.fingers import RELEASE_CLEARANCE_M
from planning.pick_place.pick import held_pick
from split_drake.poses import Array, transform_points
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose
from tests.helpers.planning import configuration

Q = configuration((0.5, 0.0, 0.25))


def tube(radius_m: float) -> Array:
    """Return points (N, 3) in G of a tube along z, around the space between the pads."""
    angles, heights = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 60), np.linspace(-0.01, 0.05, 13))
    ring = radius_m * np.column_stack([np.cos(angles.ravel()), np.sin(angles.ravel())])
    return np.column_stack([ring, heights.ravel()])


@pytest.mark.parametrize("held_m", [0.010, 0.066, 0.079])
@pytest.mark.parametrize("seen_wider_m", [-0.004, 0.0, 0.008])
def test_a_held_object_is_let_go_by_opening_clearly_further(
    held_m: float, seen_wider_m: float
) -> None:
    p_WPs = transform_points(gripper_pose(Q), tube(0.5 * (held_m + seen_wider_m)))
    pick = held_pick(Q, held_m, PerceivedObject.from_cloud(p_WPs, None, 0.0))
    assert pick.release_m >= min(MAX_OPENING_M, held_m + 2.0 * RELEASE_CLEARANCE_M) - 1e-9
    assert pick.release_m <= MAX_OPENING_M + 1e-9
    assert pick.held_width_m == held_m
