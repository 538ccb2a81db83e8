"""Inverse kinematics, verified by Drake's forward kinematics of the URDF."""

from functools import cache

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from planning.geometry.waypoints import shifted, straight_line
from planning.motion.ik import MAX_JUMP_RAD, DrakeIk, follow, solve_ik
from planning.pick_place.pick import Q_COMFORT
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.robot.kinematics import (
    closed_form_ik,
    gripper_pose,
    gripper_poses,
)
from split_drake.robot.panda import (
    GRIPPER_FRAME,
    add_panda,
    arm_limits,
    gripper_jacobian,
    panda_positions,
)
from split_drake.robot.posture import Q_HOME


@cache
def _plant() -> MultibodyPlant:
    plant = MultibodyPlant(time_step=0.001)
    add_panda(plant)
    plant.Finalize()
    return plant


def drake_fk(q: Array) -> Array:
    context = _plant().CreateDefaultContext()
    _plant().SetPositions(context, panda_positions(q, 0.0))
    return _plant().GetFrameByName(GRIPPER_FRAME).CalcPoseInWorld(context).GetAsMatrix4()


def random_qs(count: int, seed: int = 0) -> Array:
    limits = arm_limits()
    rng = np.random.default_rng(seed)
    return rng.uniform(limits.q_lower + 0.1, limits.q_upper - 0.1, (count, 7))


def table_poses(count: int, seed: int = 1) -> Array:
    """Return poses over the table, pointing down within a tilt."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        R = rotation_z(rng.uniform(-np.pi, np.pi)) @ rotation_x(np.pi + rng.uniform(-0.9, 0.9))
        p = rng.uniform((0.4, -0.2, 0.05), (0.6, 0.2, 0.3))
        poses.append(make_pose(R, p))
    return np.stack(poses)


def test_forward_kinematics_agree_with_the_urdf() -> None:
    qs = random_qs(30)
    for q, X_WG in zip(qs, gripper_poses(qs), strict=True):
        np.testing.assert_allclose(X_WG, drake_fk(q), atol=1e-9)


def test_jacobian_agrees_with_finite_differences() -> None:
    q, step = random_qs(1)[0], 1e-6
    columns = [
        (gripper_pose(q + step * e)[:3, 3] - gripper_pose(q - step * e)[:3, 3]) / (2.0 * step)
        for e in np.eye(7)
    ]
    np.testing.assert_allclose(gripper_jacobian(q), np.column_stack(columns), atol=1e-7)


def test_every_solution_reaches_its_pose_inside_the_limits() -> None:
    X_WGs = table_poses(20)
    solutions = solve_ik(X_WGs)
    limits = arm_limits()
    assert len(np.unique(solutions.pose_index)) == len(X_WGs)
    for q, pose in zip(solutions.qs, solutions.pose_index, strict=True):
        np.testing.assert_allclose(drake_fk(q), X_WGs[pose], atol=1e-6)
        assert np.all((q > limits.q_lower) & (q < limits.q_upper))


def test_the_configuration_behind_a_pose_is_among_the_solutions() -> None:
    rng = np.random.default_rng(3)
    qs = Q_COMFORT + rng.uniform(-0.4, 0.4, (50, 7))
    solutions, index = closed_form_ik(gripper_poses(qs), qs[:, 6:])
    for pose, q in enumerate(qs):
        assert np.abs(solutions[index == pose] - q).max(axis=1).min() < 1e-5


def test_poses_out_of_reach_have_no_solution() -> None:
    assert len(solve_ik(make_pose(rotation_x(np.pi), (1.5, 0.0, 0.3))[None]).qs) == 0


def test_straight_lines_are_continuous_and_straight() -> None:
    followed = 0
    for X_WG in table_poses(5):
        line = straight_line(X_WG, shifted(X_WG, (0.0, 0.0, 0.1)), 0.01)
        paths = [follow(q, line) for q in solve_ik(X_WG[None]).of(0, Q_COMFORT)]
        for path in (path for path in paths if path is not None):
            followed += 1
            assert np.abs(np.diff(path, axis=0)).max() < MAX_JUMP_RAD
            np.testing.assert_allclose(gripper_poses(path), line, atol=1e-6)
    assert followed >= 5


def test_a_line_that_leaves_the_workspace_is_refused() -> None:
    X_WG = table_poses(1)[0]
    q = solve_ik(X_WG[None]).of(0, Q_HOME)[0]
    assert follow(q, straight_line(X_WG, shifted(X_WG, (1.0, 0.0, 0.0)), 0.02)) is None


def test_refinement_keeps_the_pose_and_comes_nearer_to_comfort() -> None:
    ik, comfort = DrakeIk(), Q_COMFORT
    refined = 0
    for X_WG in table_poses(10):
        seed = solve_ik(X_WG[None]).of(0, comfort)[0]
        q = ik.refine(X_WG, seed, comfort)
        if q is None:
            continue
        refined += 1
        np.testing.assert_allclose(drake_fk(q), X_WG, atol=3e-4)
        assert np.linalg.norm(q - comfort) <= np.linalg.norm(seed - comfort) + 1e-3
    assert refined >= 8


def test_solutions_come_nearest_first() -> None:
    X_WG = table_poses(1)[0]
    near = solve_ik(X_WG[None]).of(0, Q_HOME)
    distances = np.abs(near - Q_HOME).max(axis=1)
    assert len(near) > 1
    assert np.all(np.diff(distances) >= 0.0)


@pytest.mark.parametrize("shape", [(3,), (8,)])
def test_wrong_shapes_are_errors(shape: tuple[int, ...]) -> None:
    with pytest.raises((ValueError, IndexError)):
        gripper_pose(np.zeros(shape))
