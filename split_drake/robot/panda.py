"""The Panda arm and hand in a MultibodyPlant: names, home configuration, limits.

The model is `models/panda/panda_arm_hand.urdf`; its positions in a plant are the seven arm joints
followed by the two fingers, each of which moves by half the opening.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, ModelInstanceIndex
from pydrake.systems.framework import Context

from split_drake.models_folder import MODELS_FOLDER
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M

PANDA_URDF = MODELS_FOLDER / "panda" / "panda_arm_hand.urdf"

ARM_JOINTS = tuple(f"panda_joint{number}" for number in range(1, 8))
FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")
FINGER_BODIES = ("panda_leftfinger", "panda_rightfinger")
HAND_BODIES = ("panda_hand", *FINGER_BODIES)
MOVING_BODIES = (*(f"panda_link{number}" for number in range(1, 8)), *HAND_BODIES)
GRIPPER_FRAME = "gripper"

# Upper bounds of the torques that carry the arm's own weight, from 20,000 random configurations.
MAX_WEIGHT_NM = (0.0, 57.0, 30.0, 23.0, 2.7, 2.5, 0.1)


@dataclass(frozen=True)
class ArmLimits:
    """Limits of the seven arm joints, each (7,).

    Attributes:
        q_lower, q_upper: positions, rad.
        v_max: speeds, rad/s.
        a_max: accelerations, rad/s^2.
        effort_max_nm: torques, N m.
    """

    q_lower: Array
    q_upper: Array
    v_max: Array
    a_max: Array
    effort_max_nm: Array


def add_panda(plant: MultibodyPlant) -> ModelInstanceIndex:
    """Add the Panda with its base welded to the world's origin, and return its model instance.

    The plant must not be finalized.  The fingers' coupling (a mimic joint) acts in discrete plants
    that use SAP.
    """
    parser = Parser(plant)
    parser.package_map().AddPackageXml(MODELS_FOLDER / "package.xml")
    (panda,) = parser.AddModels(PANDA_URDF)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0", panda))
    return panda


def panda_positions(q: Array, opening_m: float) -> Array:
    """Return the model's positions (9,): arm joints `q` (7,) in rad and both fingers in metres."""
    if np.shape(q) != (7,):
        raise ValueError(f"q has shape {np.shape(q)}; expected (7,)")
    if not 0.0 <= opening_m <= MAX_OPENING_M + 1e-9:
        raise ValueError(f"opening_m is {opening_m}; expected 0 to {MAX_OPENING_M}")
    return np.concatenate([q, [opening_m / 2.0] * 2])


@lru_cache(maxsize=1)
def _panda_alone() -> tuple[MultibodyPlant, Context]:
    plant = MultibodyPlant(time_step=0.001)
    add_panda(plant)
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def weight_torques_nm(q: Array) -> Array:
    """Return the torques (7,) that hold the arm with an empty hand still at `q` (7,)."""
    plant, context = _panda_alone()
    plant.SetPositions(context, panda_positions(q, 0.0))
    return -np.asarray(plant.CalcGravityGeneralizedForces(context))[:7]


def gripper_jacobian(q: Array) -> Array:
    """Return the (3, 7) Jacobian of G's origin in W at joint angles `q` (7,)."""
    plant, context = _panda_alone()
    plant.SetPositions(context, panda_positions(q, 0.0))
    W, G = plant.world_frame(), plant.GetFrameByName(GRIPPER_FRAME)
    by_speeds = JacobianWrtVariable.kV
    return plant.CalcJacobianTranslationalVelocity(context, by_speeds, G, np.zeros(3), W, W)[:, :7]


def gripper_force(q: Array, torques_nm: Array) -> Array:
    """Return the force (3,) in W at the gripper that best explains the joint torques (7,).

    The least-squares solution of tau = J^T f for the position Jacobian J at `q` (7,).
    """
    return np.asarray(np.linalg.lstsq(gripper_jacobian(q).T, torques_nm, rcond=None)[0], float)


@lru_cache(maxsize=1)
def arm_limits() -> ArmLimits:
    """Return the arm's limits as the URDF gives them."""
    plant, _ = _panda_alone()
    joints = [plant.GetJointByName(name) for name in ARM_JOINTS]
    actuators = [plant.GetJointActuatorByName(name) for name in ARM_JOINTS]
    return ArmLimits(
        q_lower=_read_only([joint.position_lower_limit() for joint in joints]),
        q_upper=_read_only([joint.position_upper_limit() for joint in joints]),
        v_max=_read_only([joint.velocity_upper_limit() for joint in joints]),
        a_max=_read_only([joint.acceleration_upper_limit() for joint in joints]),
        effort_max_nm=_read_only([actuator.effort_limit() for actuator in actuators]),
    )


def _read_only(values: ArrayLike) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
