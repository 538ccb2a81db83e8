"""The arm's kinematics against Drake's plant, link by link, and forces from joint torques."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from split_drake.poses import Array
from split_drake.robot.kinematics import (
    LIMIT_MARGIN_RAD,
    closed_form_ik,
    gripper_poses,
    link_poses,
)
from split_drake.robot.panda import (
    add_panda,
    arm_limits,
    gripper_force,
    gripper_jacobian,
    panda_positions,
)
from split_drake.robot.posture import Q_HOME


@pytest.fixture(scope="module")
def drake() -> tuple[MultibodyPlant, Context]:
    plant = MultibodyPlant(time_step=0.001)
    add_panda(plant)
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def random_qs(count: int) -> Array:
    limits = arm_limits()
    return np.random.default_rng(4).uniform(limits.q_lower, limits.q_upper, (count, 7))


def test_every_link_is_where_drake_has_it(drake: tuple[MultibodyPlant, Context]) -> None:
    plant, context = drake
    qs = random_qs(10)
    for q, X_WLs in zip(qs, link_poses(qs), strict=True):
        plant.SetPositions(context, panda_positions(q, 0.03))
        for number, X_WL in enumerate(X_WLs, start=1):
            link = plant.GetBodyByName(f"panda_link{number}")
            expected = plant.EvalBodyPoseInWorld(context, link).GetAsMatrix4()
            np.testing.assert_allclose(X_WL, expected, atol=1e-9, err_msg=link.name())


def test_torques_that_no_force_explains_are_explained_as_well_as_they_can() -> None:
    rng = np.random.default_rng(5)
    for q, torques_nm in zip(random_qs(10), rng.normal(size=(10, 7)), strict=True):
        jacobian, force_n = gripper_jacobian(q), gripper_force(q, torques_nm)
        left_nm = torques_nm - jacobian.T @ force_n
        np.testing.assert_allclose(jacobian @ left_nm, 0.0, atol=1e-9)
        # What is left over is felt as no force at all.
        np.testing.assert_allclose(gripper_force(q, left_nm), 0.0, atol=1e-9)


@pytest.mark.parametrize("joint", [0, 2, 3, 5])
@pytest.mark.parametrize(("share", "expected"), [(0.9, False), (1.1, True)])
def test_configurations_too_near_to_a_limit_are_no_solutions(
    joint: int, share: float, expected: bool
) -> None:
    q = Q_HOME.copy()
    q[joint] = arm_limits().q_lower[joint] + share * LIMIT_MARGIN_RAD
    solutions, _ = closed_form_ik(gripper_poses(q[None]), q[6:])
    found = len(solutions) > 0 and np.abs(solutions - q).max(axis=1).min() < 1e-4
    assert found == expected


def test_each_pose_may_have_values_of_the_last_joint_of_its_own() -> None:
    qs = Q_HOME + np.linspace(-0.3, 0.3, 5)[:, None] * np.ones(7)
    solutions, index = closed_form_ik(gripper_poses(qs), qs[:, 6:])
    np.testing.assert_allclose(solutions[:, 6], qs[index, 6], atol=1e-12)
    assert (np.diff(index) >= 0).all() and set(index) == set(range(5))
    none, of_none = closed_form_ik(np.empty((0, 4, 4)), qs[0, 6:])
    assert none.shape == (0, 7) and of_none.shape == (0,)
