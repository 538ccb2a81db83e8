"""Visibility of grasps on plain shapes, where the witnesses are known."""

import numpy as np
import pytest
import trimesh

from split_drake.grasps.visibility import VISIBLE_WITHIN_M, GraspVisibility
from split_drake.poses import Array, make_pose, rotation_x, rotation_z

DOWN = rotation_x(np.pi)
X_WO = make_pose(rotation_z(0.7), (0.5, 0.1, 0.02))


def seen(mesh: trimesh.Trimesh, X_OG: Array, p_OPs: list[tuple[float, float, float]]) -> bool:
    """Return whether one grasp shows, given a cloud in O."""
    visibility = GraspVisibility(mesh, X_OG[None], np.array([0.06]))
    p_WPs = np.asarray(p_OPs) @ X_WO[:3, :3].T + X_WO[:3, 3]
    return bool(visibility.visible(X_WO, p_WPs)[0])


@pytest.fixture(scope="module")
def block() -> trimesh.Trimesh:
    """A block of 3 cm, its top at z = 0.05."""
    return trimesh.creation.box((0.03, 0.03, 0.10))


@pytest.fixture(scope="module")
def frame() -> trimesh.Trimesh:
    """Two bars along x, 3 cm apart, their outer sides at y = +-0.025; nothing between them."""
    bar = trimesh.creation.box((0.1, 0.01, 0.01))
    return trimesh.util.concatenate(
        [bar.copy().apply_translation((0.0, y, 0.0)) for y in (-0.02, 0.02)]
    )


def test_a_grasp_shows_where_its_approach_meets_the_surface(block: trimesh.Trimesh) -> None:
    X_OG = make_pose(DOWN, (0.002, 0.0, 0.04))
    assert seen(block, X_OG, [(0.002, 0.0, 0.05)])
    assert not seen(block, X_OG, [(0.015, 0.0, 0.04), (-0.015, 0.0, 0.04), (0.0, 0.015, 0.03)])


def test_a_point_of_the_cloud_must_lie_within_5_mm(block: trimesh.Trimesh) -> None:
    X_OG = make_pose(DOWN, (0.0, 0.0, 0.04))
    near, far = VISIBLE_WITHIN_M - 1e-4, VISIBLE_WITHIN_M + 1e-4
    assert seen(block, X_OG, [(near, 0.0, 0.05)])
    assert not seen(block, X_OG, [(far, 0.0, 0.05), (0.0, 0.0, 0.05 + far)])


def test_the_hidden_side_does_not_show(block: trimesh.Trimesh) -> None:
    from_the_side = np.column_stack([[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]])
    X_OG = make_pose(from_the_side, (0.005, 0.0, 0.0))
    assert seen(block, X_OG, [(0.015, 0.0, 0.0)])
    assert not seen(block, X_OG, [(-0.015, 0.0, 0.0)])


def test_where_nothing_is_in_the_way_one_contact_is_enough(frame: trimesh.Trimesh) -> None:
    X_OG = make_pose(DOWN)
    for y in (-0.025, 0.025):
        assert seen(frame, X_OG, [(0.0, y, 0.0)])
    assert not seen(frame, X_OG, [(0.02, 0.025, 0.0), (0.0, 0.0, 0.0)])


def test_a_floor_far_below_shows_a_grasp_as_its_contacts_do(frame: trimesh.Trimesh) -> None:
    floor = trimesh.creation.box((0.1, 0.05, 0.01)).apply_translation((0.0, 0.0, -0.06))
    cup = trimesh.util.concatenate([frame, floor])
    X_OG = make_pose(DOWN)
    assert seen(cup, X_OG, [(0.0, 0.0, -0.055)])
    assert seen(cup, X_OG, [(0.0, 0.025, 0.0)])
    assert not seen(cup, X_OG, [(0.0, 0.0, 0.0)])


def test_grasps_that_meet_nothing_never_show(block: trimesh.Trimesh) -> None:
    X_OG = make_pose(DOWN, (0.2, 0.0, 0.0))
    assert not seen(block, X_OG, [(0.2, 0.0, 0.0), (0.0, 0.0, 0.05)])


def test_each_grasp_is_judged_on_its_own(block: trimesh.Trimesh) -> None:
    X_OGs = make_pose(DOWN, [(0.0, 0.0, 0.04), (0.2, 0.0, 0.0), (0.0, 0.0, -0.02)])
    X_OGs[2, :3, :3] = np.eye(3)  # From below: meets the bottom at z = -0.05.
    visibility = GraspVisibility(block, X_OGs, np.full(3, 0.06))
    p_WPs = np.array([[0.0, 0.0, 0.05]]) @ X_WO[:3, :3].T + X_WO[:3, 3]
    assert visibility.visible(X_WO, p_WPs).tolist() == [True, False, False]
