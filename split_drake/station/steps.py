"""The steps by which a station's diagram is built, each a function of the builder or the plant."""

from collections.abc import Sequence

from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    ProximityProperties,
    RoleAssign,
    SceneGraph,
)
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink
from pydrake.systems.sensors import RgbdSensor

from split_drake.robot.arm_command import arm_command_system
from split_drake.robot.panda import ARM_JOINTS, FINGER_BODIES, FINGER_JOINTS, MAX_WEIGHT_NM
from split_drake.station.config import StationConfig
from split_drake.station.detector_system import PoseDetectorSystem

# Edges of the meshes that stand for round shapes in hydroelastic contact.
_MESH_EDGE_M = 0.004


def add_plant(builder: DiagramBuilder, config: StationConfig) -> tuple[MultibodyPlant, SceneGraph]:
    """Return an empty plant with the configured contact, and its scene graph."""
    plant_config = MultibodyPlantConfig(
        time_step=config.time_step_s,
        contact_model=config.contact_model,
        discrete_contact_approximation=config.contact_approximation,
        sap_near_rigid_threshold=config.near_rigid_threshold,
    )
    return AddMultibodyPlant(plant_config, builder)


def set_actuator_gains(
    plant: MultibodyPlant, panda: ModelInstanceIndex, config: StationConfig
) -> None:
    """Let the actuators track desired states; the arm's own weight is compensated for.

    What its weight takes at most is left out of the torques that they may exert, so that both
    together keep the joints' limits.
    """
    finger = (config.finger_kp_n_per_m, config.finger_kd_ns_per_m)
    arm = zip(config.arm_kp_nm_per_rad, config.arm_kd_nms_per_rad, strict=True)
    for name, (p, d) in zip(ARM_JOINTS + FINGER_JOINTS, (*arm, finger, finger), strict=True):
        plant.GetJointActuatorByName(name, panda).set_controller_gains(PdControllerGains(p=p, d=d))
    for name, weight_nm in zip(ARM_JOINTS, MAX_WEIGHT_NM, strict=True):
        actuator = plant.GetJointActuatorByName(name, panda)
        actuator.set_effort_limit(actuator.effort_limit() - weight_nm)
    plant.set_gravity_enabled(panda, False)


def set_contact_material(
    plant: MultibodyPlant, scene_graph: SceneGraph, config: StationConfig
) -> None:
    """Give every collision geometry the material of the configuration."""
    for index in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        material = _material(config, compliant=body.name() in FINGER_BODIES)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            scene_graph.AssignRole(plant.get_source_id(), geometry, material, RoleAssign.kReplace)


def _material(config: StationConfig, compliant: bool) -> ProximityProperties:
    material = ProximityProperties()
    AddContactMaterial(
        dissipation=config.dissipation_s_per_m,
        point_stiffness=config.point_stiffness_n_per_m,
        friction=CoulombFriction(config.friction, config.friction),
        properties=material,
    )
    material.AddProperty("material", "relaxation_time", config.relaxation_time_s)
    if config.contact_model != "point":
        if compliant:
            AddCompliantHydroelasticProperties(_MESH_EDGE_M, config.pad_modulus_pa, material)
        else:
            AddRigidHydroelasticProperties(_MESH_EDGE_M, material)
    return material


def add_command(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    panda: ModelInstanceIndex,
    config: StationConfig,
) -> None:
    """Add what turns commands of arm and gripper into the joints' desired states."""
    command = builder.AddNamedSystem("command", arm_command_system(config.finger_kp_n_per_m))
    builder.Connect(plant.get_state_output_port(panda), command.GetInputPort("measured"))
    builder.Connect(
        command.GetOutputPort("desired_state"), plant.get_desired_state_input_port(panda)
    )
    builder.ExportInput(command.GetInputPort("arm"), "arm")
    builder.ExportInput(command.GetInputPort("gripper"), "gripper")


def export_state(builder: DiagramBuilder, plant: MultibodyPlant, panda: ModelInstanceIndex) -> None:
    """Export the Panda's positions and velocities, and the efforts of its joints."""
    builder.ExportOutput(plant.get_state_output_port(panda), "panda_state")
    builder.ExportOutput(plant.get_net_actuation_output_port(panda), "panda_torques")


def add_logs(
    builder: DiagramBuilder, plant: MultibodyPlant, panda: ModelInstanceIndex
) -> tuple[VectorLogSink, VectorLogSink]:
    """Let the Panda's state, and the efforts of its joints, be logged after every step."""
    return (
        LogVectorOutput(plant.get_state_output_port(panda), builder),
        LogVectorOutput(plant.get_net_actuation_output_port(panda), builder),
    )


def add_detector(
    builder: DiagramBuilder, system: PoseDetectorSystem, cameras: Sequence[RgbdSensor]
) -> None:
    """Add a detector that reads all cameras, and export its scene and its pose sets."""
    builder.AddNamedSystem("detector", system)
    for camera in cameras:
        builder.Connect(
            camera.depth_image_32F_output_port(), system.GetInputPort(camera.get_name())
        )
    builder.ExportOutput(system.GetOutputPort("scene"), "scene")
    builder.ExportOutput(system.GetOutputPort("pose_sets"), "pose_sets")


def add_meshcat(
    builder: DiagramBuilder, scene_graph: SceneGraph, meshcat: Meshcat, config: StationConfig
) -> None:
    """Let a Meshcat show the scene, at the rate of the configuration."""
    params = MeshcatVisualizerParams(publish_period=1.0 / config.meshcat_rate_hz)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
