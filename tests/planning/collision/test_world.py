"""The collision world: each kind of contact, and exactly the declared exemptions."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pydrake.geometry import QueryObject
from pydrake.planning import RobotDiagramBuilder

from planning.collision.distances import (
    arm_capsules,
    distance_to_box,
    distance_to_segments,
    hook_capsules,
)
from planning.collision.exemptions import MAX_TABLE_DEPTH_M
from planning.collision.world import (
    EDGE_STEP_RAD,
    POINT_RADIUS_M,
    CollisionWorld,
    Situation,
    densified,
)
from planning.subgoal import AllowedContact
from split_drake.poses import Array, transform_points
from split_drake.robot.gripper import PALM, Box
from split_drake.robot.kinematics import gripper_pose, link_poses
from split_drake.robot.panda import add_panda, arm_limits, panda_positions
from split_drake.robot.posture import Q_HOME
from split_drake.station.fixtures import add_hook, add_table
from split_drake.station.layout import Layout, OpenBin
from tests.helpers.planning import configuration

FINGERS = frozenset({AllowedContact.FINGERS_TARGET})
TABLE = frozenset({AllowedContact.HELD_TABLE})
PEG = frozenset({AllowedContact.HELD_PEG})


@cache
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


def is_free(q: Array, situation: Situation) -> bool:
    return bool(world().free(q[None], situation)[0])


@contextmanager
def query_at(q: Array, opening_m: float) -> Iterator[QueryObject]:
    """Answer by Drake; a query reads its diagram and context, which live as long as the block."""
    builder = RobotDiagramBuilder(time_step=0.001)
    panda = add_panda(builder.plant())
    add_table(builder.plant(), Layout())
    add_hook(builder.plant(), Layout())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant = diagram.plant()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(plant_context, panda, panda_positions(q, opening_m))
    yield plant.get_geometry_query_input_port().Eval(plant_context)


def test_robot_against_table_hook_and_itself() -> None:
    opened = Situation(0.08)
    assert is_free(Q_HOME, opened)
    assert is_free(configuration((0.5, 0.0, 0.02)), opened)
    assert not is_free(configuration((0.5, 0.0, 0.005)), opened)
    x, y, z = Layout().X_WK[:3, 3]
    assert not is_free(configuration((x, y, z)), opened)
    folded = np.array([0.0, 1.6, 0.0, -3.0, 0.0, 0.1, 0.0])
    assert not is_free(folded, opened)


def test_capsule_distances_agree_with_drake() -> None:
    rng = np.random.default_rng(0)
    limits = arm_limits()
    q = rng.uniform(limits.q_lower, limits.q_upper)
    points = rng.uniform((-0.2, -0.5, 0.1), (0.8, 0.5, 1.0), (200, 3))
    X_WLs = np.concatenate([np.eye(4)[None], link_poses(q[None])[0]])
    capsules = [
        (transform_points(X_WLs[link], capsule.p_FEnds), capsule.radius_m)
        for link, capsule in arm_capsules()
    ]
    capsules += [(capsule.p_FEnds, capsule.radius_m) for capsule in hook_capsules(Layout())[:1]]
    ours = np.stack([distance_to_segments(points, *ends) - radius for ends, radius in capsules])
    with query_at(q, 0.0) as query:
        for index, point in enumerate(points):
            hits = query.ComputeSignedDistanceToPoint(point, 2.0)
            exact = np.sort([hit.distance for hit in hits])
            for distance in ours[:, index]:
                assert np.abs(exact - distance).min() < 1e-9


def test_box_distances() -> None:
    box = Box((-1.0, -2.0, -3.0), (1.0, 2.0, 3.0))
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [4.0, 6.0, 0.0], [1.0, 2.0, 5.0]])
    np.testing.assert_allclose(distance_to_box(points, box), [0.0, 1.0, 5.0, 2.0])


def test_standing_objects_block_palm_arm_and_fingers() -> None:
    q = configuration((0.5, 0.0, 0.15))
    for p_G in ((0.0, 0.0, PALM.upper[2] + 0.002), (0.0, 0.0, -0.2), (0.0, 0.047, 0.0)):
        p_W = transform_points(gripper_pose(q), np.array([p_G]))
        assert not is_free(q, Situation(0.08, p_WStanding=p_W)), p_G
    between = transform_points(gripper_pose(q), np.zeros((1, 3)))
    assert is_free(q, Situation(0.08, p_WStanding=between))
    assert not is_free(q, Situation(0.005, p_WStanding=between))


def test_fingers_target_exempts_the_fingers_alone() -> None:
    q = configuration((0.5, 0.0, 0.15))
    at_finger, at_palm = transform_points(
        gripper_pose(q), np.array([[0.0, 0.047, 0.0], [0.0, 0.0, -0.05]])
    )
    assert is_free(q, Situation(0.08, p_WStanding=at_finger[None], allowed=FINGERS))
    assert not is_free(q, Situation(0.08, p_WStanding=at_palm[None], allowed=FINGERS))


def test_held_table_exempts_the_table_alone() -> None:
    q = configuration((0.5, 0.0, 0.08))
    below = Situation(0.03, p_GHeld=np.array([[0.0, 0.0, 0.079]]))
    assert not is_free(q, below)
    assert is_free(q, Situation(0.03, p_GHeld=below.p_GHeld, allowed=TABLE))
    link, capsule = arm_capsules()[-2]
    assert link == 6
    p_WInside = transform_points(link_poses(q[None])[0, link - 1], capsule.p_FEnds[:1])
    into_wrist = transform_points(np.linalg.inv(gripper_pose(q)), p_WInside)
    assert not is_free(q, Situation(0.03, p_GHeld=into_wrist, allowed=TABLE))


def test_held_table_exempts_no_deep_contact_and_none_of_a_lifted_object() -> None:
    q = configuration((0.5, 0.0, 0.08))
    z_WG = gripper_pose(q)[2, 3]
    for depth, expected in ((0.9 * MAX_TABLE_DEPTH_M, True), (1.1 * MAX_TABLE_DEPTH_M, False)):
        p_GHeld = np.array([[0.0, 0.0, z_WG + depth]])
        assert is_free(q, Situation(0.03, p_GHeld=p_GHeld, allowed=TABLE)) is expected
    touching = Situation(0.03, p_GHeld=np.array([[0.0, 0.0, z_WG]]), allowed=TABLE)
    assert is_free(q, replace(touching, table_below_m=z_WG + 0.001))
    assert not is_free(q, replace(touching, table_below_m=z_WG - 0.001))


def test_held_peg_exempts_only_the_tube_and_never_the_post() -> None:
    q = configuration((0.5, -0.2, 0.4))
    peg, post = hook_capsules(Layout())
    ends = np.stack([peg.p_FEnds.mean(axis=0), post.p_FEnds.mean(axis=0)])
    p_GHeld = transform_points(np.linalg.inv(gripper_pose(q)), ends)
    exempt, strict = np.array([True]), np.array([False])
    on_peg, on_post = p_GHeld[:1], p_GHeld[1:]
    assert not is_free(q, Situation(0.03, p_GHeld=on_peg))
    assert is_free(q, Situation(0.03, p_GHeld=on_peg, peg_exempt=exempt, allowed=PEG))
    assert not is_free(q, Situation(0.03, p_GHeld=on_peg, peg_exempt=strict, allowed=PEG))
    assert not is_free(q, Situation(0.03, p_GHeld=on_post, peg_exempt=exempt, allowed=PEG))
    with pytest.raises(ValueError, match="peg_exempt"):
        is_free(q, Situation(0.03, p_GHeld=on_peg, allowed=PEG))


def test_held_points_keep_clear_of_what_stands() -> None:
    q = configuration((0.5, 0.0, 0.2))
    p_GHeld = np.array([[0.0, 0.0, 0.06]])
    below = transform_points(gripper_pose(q), p_GHeld)
    for gap_m, expected in ((1.9 * POINT_RADIUS_M, False), (2.1 * POINT_RADIUS_M, True)):
        standing = below - (0.0, 0.0, gap_m)
        assert is_free(q, Situation(0.03, p_WStanding=standing, p_GHeld=p_GHeld)) is expected


def test_arm_and_held_points_keep_clear_of_the_bin() -> None:
    bin = OpenBin((0.4, -0.4, 0.1), (0.3, 0.3, 0.09))
    with_bin = CollisionWorld(replace(Layout(), bin=bin))
    above = configuration((0.4, -0.4, 0.25))[None]
    wall = configuration((0.4 - 0.155, -0.4, 0.11))[None]
    assert with_bin.free(above, Situation(0.0))[0]
    assert not with_bin.free(wall, Situation(0.0))[0]
    assert is_free(wall[0], Situation(0.0)), "where there is no bin"
    p_GRim = transform_points(np.linalg.inv(gripper_pose(above[0])), [(0.4 - 0.155, -0.4, 0.1)])
    p_GInside = transform_points(np.linalg.inv(gripper_pose(above[0])), [(0.4, -0.4, 0.1)])
    assert not with_bin.free(above, Situation(0.0, p_GHeld=p_GRim))[0]
    assert with_bin.free(above, Situation(0.0, p_GHeld=p_GInside))[0]


def test_paths_are_checked_between_their_ends() -> None:
    left, right = configuration((0.5, -0.15, 0.1)), configuration((0.5, 0.15, 0.1))
    wall = np.array([[0.5, 0.0, z] for z in np.arange(0.0, 0.3, 0.01)])
    situation = Situation(0.08, p_WStanding=wall)
    assert world().free(np.stack([left, right]), situation).all()
    assert not world().path_free(np.stack([left, right]), situation)
    assert world().path_free(np.stack([left, right]), Situation(0.08))


def test_densified_paths_keep_their_corners() -> None:
    corners = np.array([[0.0] * 7, [0.1] * 7, [0.1] * 6 + [0.3]])
    dense = densified(corners, EDGE_STEP_RAD)
    assert np.abs(np.diff(dense, axis=0)).max() <= EDGE_STEP_RAD + 1e-12
    for corner in corners:
        assert np.abs(dense - corner).max(axis=1).min() < 1e-12


def test_a_point_is_as_thick_as_its_radius() -> None:
    q = configuration((0.5, 0.0, 0.15))
    for gap, expected in ((0.9, False), (1.1, True)):
        p_G = np.array([[0.0, 0.0, PALM.upper[2] + gap * POINT_RADIUS_M]])
        p_W = transform_points(gripper_pose(q), p_G)
        assert is_free(q, Situation(0.08, p_WStanding=p_W)) is expected
