"""How objects come to rest, and grasps that suit it."""

import numpy as np
import pytest
import trimesh

from split_drake.grasps.lying import CLEARANCE_M, MAX_BACK_M, grasps_from_above, resting_poses
from split_drake.grasps.sampling import antipodal_lines
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, gripper_boxes


def lowest_m(X_TG: Array) -> float:
    """Return the height of the lowest point of a hand that is wide open."""
    boxes = gripper_boxes(MAX_OPENING_M)
    corners = np.concatenate([trimesh.bounds.corners([b.lower, b.upper]) for b in boxes])
    return float(transform_points(X_TG, corners)[:, 2].min())


def test_a_box_rests_upright_and_on_each_kind_of_side() -> None:
    box = trimesh.creation.box((0.02, 0.05, 0.09))
    X_TOs = resting_poses(box, np.zeros(3))
    np.testing.assert_allclose(X_TOs[0], make_pose(p=(0.0, 0.0, 0.045)), atol=1e-9)
    heights = {round(float(transform_points(X, box.vertices)[:, 2].max()), 3) for X in X_TOs}
    assert {0.02, 0.05} <= heights
    for X_TO in X_TOs:
        assert transform_points(X_TO, box.vertices)[:, 2].min() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("height_m", [0.02, 0.06])
def test_hands_from_above_clear_the_table_and_pinch_on_the_line(height_m: float) -> None:
    bar = trimesh.creation.box((0.03, 0.12, height_m))
    X_TO = make_pose(p=(0.3, -0.2, height_m / 2.0))
    rng = np.random.default_rng(0)
    lines = antipodal_lines(bar, 2000, rng, 0.009)
    X_OGs = grasps_from_above(lines, X_TO, 40, rng)
    assert 20 <= len(X_OGs) <= 40
    for X_OG in X_OGs:
        X_TG = X_TO @ X_OG
        assert X_TG[2, 2] < -0.7, "the hand points down"
        assert lowest_m(X_TG) > CLEARANCE_M[0] - 1e-9
        assert abs(X_TG[2, 1]) < np.sin(np.radians(21.0)), "the pads are about level"
        middles = lines.mean(axis=1)
        off_m = np.linalg.norm(middles - (X_OG[:3, 3] + 0.0), axis=1).min()
        assert off_m < MAX_BACK_M + 1e-6


def test_what_lies_too_flat_has_no_grasp_from_above() -> None:
    plate = trimesh.creation.box((0.05, 0.05, 0.002))
    rng = np.random.default_rng(0)
    lines = antipodal_lines(plate, 3000, rng, 0.009)
    below = make_pose(p=(0.0, 0.0, -0.02))
    assert len(grasps_from_above(lines, below, 50, rng)) == 0
    assert len(grasps_from_above(lines, make_pose(p=(0.0, 0.0, 0.2)), 50, rng)) > 0
