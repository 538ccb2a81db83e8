"""The Panda's hand without its arm, carried by a gantry, in a plant.

Three prismatic joints along the axes of W carry a wrist that is locked while time passes, and the
wrist carries the hand by its frame G.  So the hand keeps its orientation, whatever turns it, moves
where it is told, and gives way where more than `GANTRY_FORCE_N` pushes it back.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    Joint,
    ModelInstanceIndex,
    PdControllerGains,
    PrismaticJoint,
    QuaternionFloatingJoint,
    SpatialInertia,
)

from split_drake.models_folder import MODELS_FOLDER
from split_drake.robot.gripper import HAND_TO_GRIPPER_M
from split_drake.robot.panda import FINGER_JOINTS, GRIPPER_FRAME, HAND_BODIES, PANDA_URDF
from split_drake.station.config import StationConfig

# What the gantry exerts at most along each axis of W.  In its best posture for a grasp from above,
# the station's arm can exert 50 to 66 N along every axis (200 poses in the workspace, 5th to 95th
# percentile; torque limits less the arm's own weight).
GANTRY_FORCE_N = 50.0
# The hand yields 2.5 mm before the gantry's force is used up; critically damped with 1 kg in it.
GANTRY_KP_N_PER_M = 20e3
GANTRY_KD_NS_PER_M = 300.0

_DRAKE = "http://drake.mit.edu"


@dataclass(frozen=True)
class HandModel:
    """Where the hand is in a plant.

    Attributes:
        gantry: model instance of the joints x, y, z, whose positions are p_WG.
        wrist: the joint that turns the hand, to be locked; its frames are W's axes at p_WG, and G.
        hand: model instance of hand, fingers and wrist.
    """

    gantry: ModelInstanceIndex
    wrist: Joint
    hand: ModelInstanceIndex


@lru_cache(maxsize=1)
def hand_urdf() -> str:
    """Return the Panda's URDF without what belongs to the arm."""
    ET.register_namespace("drake", _DRAKE)
    robot = ET.parse(PANDA_URDF).getroot()
    kept = {*HAND_BODIES, GRIPPER_FRAME}
    for element in list(robot):
        if element.tag == "link" and element.get("name") not in kept:
            robot.remove(element)
        elif element.tag == "joint":
            ends = {end.get("link") for end in element if end.tag in ("parent", "child")}
            if not ends <= kept:
                robot.remove(element)
        elif element.tag == "transmission":
            if not {joint.get("name") for joint in element.iter("joint")} <= {*FINGER_JOINTS}:
                robot.remove(element)
        elif element.tag == f"{{{_DRAKE}}}collision_filter_group":
            _keep_members(robot, element, kept)
    return ET.tostring(robot, encoding="unicode")


def _keep_members(robot: ET.Element, group: ET.Element, kept: set[str]) -> None:
    """Leave a collision filter group the links that are kept, or remove it with the last one."""
    members = group.findall(f"{{{_DRAKE}}}member")
    if not {member.get("link") for member in members} & kept:
        robot.remove(group)
    for member in members:
        if member.get("link") not in kept:
            group.remove(member)


def add_hand(plant: MultibodyPlant, config: StationConfig) -> HandModel:
    """Add gantry and hand to a plant that isn't finalized."""
    gantry, carriage = _add_gantry(plant)
    parser = Parser(plant)
    parser.package_map().AddPackageXml(MODELS_FOLDER / "package.xml")
    (hand,) = parser.AddModelsFromString(hand_urdf(), "urdf")
    palm = plant.GetBodyByName(HAND_BODIES[0], hand)
    X_HandG = RigidTransform((0.0, 0.0, HAND_TO_GRIPPER_M))
    frame_G = plant.AddFrame(FixedOffsetFrame("wrist", palm.body_frame(), X_HandG))
    wrist = plant.AddJoint(QuaternionFloatingJoint("wrist", carriage, frame_G))
    gains = PdControllerGains(p=config.finger_kp_n_per_m, d=config.finger_kd_ns_per_m)
    for name in FINGER_JOINTS:
        plant.GetJointActuatorByName(name, hand).set_controller_gains(gains)
    for instance in (gantry, hand):
        plant.set_gravity_enabled(instance, False)
    return HandModel(gantry, wrist, hand)


def _add_gantry(plant: MultibodyPlant) -> tuple[ModelInstanceIndex, Frame]:
    """Add three prismatic joints along W's axes; return their instance and the last one's frame."""
    instance = plant.AddModelInstance("gantry")
    gains = PdControllerGains(p=GANTRY_KP_N_PER_M, d=GANTRY_KD_NS_PER_M)
    frame = plant.world_frame()
    for name, axis in zip("xyz", np.eye(3), strict=True):
        carriage = plant.AddRigidBody(f"gantry_{name}", instance, SpatialInertia.Zero())
        joint = PrismaticJoint(f"gantry_{name}", frame, carriage.body_frame(), axis)
        actuator = plant.AddJointActuator(
            f"gantry_{name}", plant.AddJoint(joint), effort_limit=GANTRY_FORCE_N
        )
        actuator.set_controller_gains(gains)
        frame = carriage.body_frame()
    return instance, frame
