"""Inverse kinematics: seeds in closed form, refinement by Drake, straight lines in joint space."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import SnoptSolver

from split_drake.poses import Array
from split_drake.robot.kinematics import LIMIT_MARGIN_RAD, closed_form_ik
from split_drake.robot.panda import (
    GRIPPER_FRAME,
    add_panda,
    arm_limits,
    panda_positions,
)
from split_drake.robot.posture import Q_HOME

# Values of the last joint at which poses are solved; a half turn of the gripper is another pose.
Q7_COUNT = 20
# Neighbouring configurations of a straight line, a few millimetres apart, lie closer than this.
MAX_JUMP_RAD = 0.25


@cache
def _q7_values() -> Array:
    limits = arm_limits()
    margin = 2.0 * LIMIT_MARGIN_RAD
    return np.linspace(limits.q_lower[6] + margin, limits.q_upper[6] - margin, Q7_COUNT)


@dataclass(frozen=True)
class IkSolutions:
    """Solutions for a batch of poses.

    Attributes:
        qs: (K, 7) joint angles, rad.
        pose_index: (K,) the pose that each solution reaches.
    """

    qs: Array
    pose_index: NDArray[np.intp]

    def of(self, pose: int, q_near: Array) -> Array:
        """Return (M, 7) the solutions of one pose, nearest to `q_near` first."""
        qs = self.qs[self.pose_index == pose]
        return qs[np.argsort(np.abs(qs - q_near).max(axis=1), kind="stable")]


def solve_ik(X_WGs: ArrayLike) -> IkSolutions:
    """Return the solutions in closed form for gripper poses (N, 4, 4), over a grid of q7."""
    qs, pose_index = closed_form_ik(X_WGs, _q7_values())
    return IkSolutions(qs, pose_index)


def follow(q_start: Array, X_WGs: ArrayLike) -> Array | None:
    """Return (N, 7) continuous joint angles through the poses (N, 4, 4), the last joint at rest.

    The poses start near `q_start`'s own; None where a pose has no solution within `MAX_JUMP_RAD`
    of the one before.
    """
    poses = np.asarray(X_WGs, dtype=float)
    qs, index = closed_form_ik(poses, np.array([q_start[6]]))
    path, q = np.empty((len(poses), 7)), q_start
    for pose in range(len(poses)):
        candidates = qs[index == pose]
        if not len(candidates):
            return None
        jumps = np.abs(candidates - q).max(axis=1)
        if jumps.min() > MAX_JUMP_RAD:
            return None
        q = path[pose] = candidates[np.argmin(jumps)]
    return path


class DrakeIk:
    """Refines a configuration by Drake's `InverseKinematics`, keeping the gripper's pose.

    Moves the redundant joint so that the arm is nearest to a comfortable posture, within the
    joint limits.
    """

    POSITION_TOLERANCE_M = 1e-5
    ANGLE_TOLERANCE_RAD = 1e-4

    def __init__(self) -> None:
        self._plant = MultibodyPlant(time_step=0.001)
        add_panda(self._plant)
        self._plant.Finalize()
        self._gripper = self._plant.GetFrameByName(GRIPPER_FRAME)

    def refine(self, X_WG: Array, q_seed: Array, q_comfort: Array = Q_HOME) -> Array | None:
        """Return (7,) joint angles that reach `X_WG`, or None where the solver finds none."""
        ik = InverseKinematics(self._plant)
        program, q = ik.prog(), ik.q()
        world, p_WG = self._plant.world_frame(), X_WG[:3, 3]
        slack = self.POSITION_TOLERANCE_M
        ik.AddPositionConstraint(self._gripper, np.zeros(3), world, p_WG - slack, p_WG + slack)
        R_WG = RotationMatrix(X_WG[:3, :3])
        ik.AddOrientationConstraint(
            world, R_WG, self._gripper, RotationMatrix(), self.ANGLE_TOLERANCE_RAD
        )
        program.AddBoundingBoxConstraint(0.0, 0.0, q[7:])
        program.AddQuadraticErrorCost(np.eye(7), q_comfort, q[:7])
        program.SetInitialGuess(q, panda_positions(q_seed, 0.0))
        result = SnoptSolver().Solve(program)
        return np.asarray(result.GetSolution(q)[:7]) if result.is_success() else None
