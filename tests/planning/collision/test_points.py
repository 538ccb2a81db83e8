"""Points against hand and arm: the batch agrees with one posture, and with plain distances."""

import numpy as np
from scipy.spatial.transform import Rotation

from planning.collision.distances import arm_capsules, distance_to_box, distance_to_segments
from planning.collision.points import POINT_RADIUS_M, apart, arm_clear, hand_clear
from planning.collision.world import CollisionWorld, Situation
from planning.subgoal import AllowedContact
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from split_drake.robot.gripper import PALM, gripper_boxes
from split_drake.robot.kinematics import gripper_pose, link_poses
from split_drake.robot.panda import arm_limits
from split_drake.station.layout import Layout


def postures(count: int, seed: int) -> Array:
    limits = arm_limits()
    return np.random.default_rng(seed).uniform(limits.q_lower, limits.q_upper, (count, 7))


def blob(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.array([0.4, 0.0, 0.4]) + rng.normal(0.0, 0.08, (60, 3))


def test_the_hand_is_clear_where_no_box_of_it_is_near_a_point() -> None:
    rng = np.random.default_rng(0)
    turns = Rotation.random(300, rng=rng).as_matrix()
    beside = blob(1).mean(axis=0) + rng.normal(0.0, 0.15, (300, 3))
    X_WGs = np.stack([make_pose(R, p) for R, p in zip(turns, beside, strict=True)])
    boxes = gripper_boxes(0.06)
    expected = [
        all(
            distance_to_box(transform_points(invert_pose(X_WG), blob(1)), box).min()
            > POINT_RADIUS_M
            for box in boxes
        )
        for X_WG in X_WGs
    ]
    assert 20 < sum(expected) < 290
    np.testing.assert_array_equal(hand_clear(X_WGs, blob(1), boxes), expected)


def test_the_arm_is_clear_where_no_capsule_of_it_is_near_a_point() -> None:
    X_WLs = link_poses(postures(300, 2))
    shared, own = blob(3), np.stack([blob(seed) for seed in range(300)])
    for last_link in (6, 7):
        for p_WPs in (shared, own):
            expected = [
                _arm_is_clear(links, points, last_link)
                for links, points in zip(X_WLs, np.broadcast_to(p_WPs, own.shape), strict=True)
            ]
            assert 20 < sum(expected) < 290
            np.testing.assert_array_equal(arm_clear(X_WLs, p_WPs, last_link), expected)


def _arm_is_clear(X_WLs: Array, p_WPs: Array, last_link: int) -> bool:
    X_WLs = np.concatenate([np.eye(4)[None], X_WLs])
    return all(
        distance_to_segments(p_WPs, *transform_points(X_WLs[link], capsule.p_FEnds)).min()
        > capsule.radius_m + POINT_RADIUS_M
        for link, capsule in arm_capsules()
        if link <= last_link
    )


def test_held_points_are_apart_from_standing_ones_by_two_radii() -> None:
    standing = np.zeros((1, 3))
    held = np.array([[[0.0, 0.0, 1.99]], [[0.0, 0.0, 2.01]], [[1.5, 1.5, 1.5]]]) * POINT_RADIUS_M
    np.testing.assert_array_equal(apart(held, standing), [False, True, True])


def test_no_configuration_is_free_where_the_hand_alone_is_not() -> None:
    world = CollisionWorld(Layout()).among(blob(4))
    held = np.random.default_rng(5).normal(0.0, 0.03, (20, 3))
    fingers = frozenset({AllowedContact.FINGERS_TARGET})
    refused = 0
    for situation in (
        Situation(0.08, p_WStanding=blob(6)),
        Situation(0.08, p_WStanding=blob(6), allowed=fingers),
        Situation(0.03, p_GHeld=held),
    ):
        for q in postures(200, 7):
            if not world.poses_free(gripper_pose(q)[None], situation):
                refused += 1
                assert not world.free(q[None], situation)[0]
    assert refused > 30


def test_a_line_is_free_where_all_its_poses_are() -> None:
    X_WG = gripper_pose(postures(1, 8)[0])
    at_palm = transform_points(X_WG, np.array([PALM.center]))
    world, standing = CollisionWorld(Layout()), Situation(0.08, p_WStanding=at_palm)
    away = X_WG.copy()
    away[:3, 3] += 0.5
    assert world.poses_free(away[None], standing)
    assert not world.poses_free(np.stack([away, X_WG]), standing)
