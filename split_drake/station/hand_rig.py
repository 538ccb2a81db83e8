"""A hand that stands still, an object, and a table that can be taken away: a small plant in Drake.

Hand, contact model and control are the station's.  The arm's joints are locked, and so is the
table, which lies in whatever direction the grasp has it.  There is no gravity: whoever uses the rig
applies what the object feels.

Frames: S is the rig's world, in which the hand stands still; G, O and W as everywhere.
"""

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import CoulombFriction, ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import Joint, RigidBody, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_FORCE_N
from split_drake.robot.panda import (
    ARM_JOINTS,
    FINGER_BODIES,
    GRIPPER_FRAME,
    HAND_BODIES,
    add_panda,
    panda_positions,
)
from split_drake.robot.posture import Q_HOME
from split_drake.station.config import StationConfig
from split_drake.station.contacts import contacts_of, penetration_m
from split_drake.station.fixtures import TABLE_BODY, add_objects, drake_shape, table_primitive
from split_drake.station.steps import (
    add_command,
    add_plant,
    set_actuator_gains,
    set_contact_material,
)

# Where the table is when it is not wanted.
_AWAY = RigidTransform((0.0, 0.0, -100.0))


class HandRig:
    """The plant and its simulator, for one object.

    Attributes:
        body: the object.
    """

    def __init__(self, body: RigidObject, config: StationConfig) -> None:
        self.body = body
        builder = DiagramBuilder()
        self._plant, scene_graph = add_plant(builder, config)
        self._panda = add_panda(self._plant)
        set_actuator_gains(self._plant, self._panda, config)
        (self._object,) = add_objects(self._plant, (body,))
        self._table = _add_loose_table(self._plant, config)
        set_contact_material(self._plant, scene_graph, config)
        self._plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        self._plant.Finalize()
        # A free body has its joint once the plant is final.
        self._table_joint = _floating_joint(self._plant, self._table)
        _let_only_the_hand_touch(self._plant, scene_graph, self._table)
        add_command(builder, self._plant, self._panda, config)
        builder.ExportInput(self._plant.get_applied_spatial_force_input_port(), "load")
        self._diagram = builder.Build()
        self._simulator = Simulator(self._diagram)
        self._lock()
        home = panda_positions(Q_HOME, 0.0)
        self._plant.SetPositions(self._plant_context, self._panda, home)
        frame = self._plant.GetFrameByName(GRIPPER_FRAME)
        self._X_SG: RigidTransform = frame.CalcPoseInWorld(self._plant_context)

    def reset(self, X_GO: Array, opening_m: float, X_GW: Array | None = None) -> None:
        """Start anew: everything at rest, the pads `opening_m` apart, the table at X_GW if given.

        X_GO and X_GW are (4, 4).
        """
        plant, context = self._plant, self._plant_context
        self._context.SetTime(0.0)
        plant.SetPositions(context, self._panda, panda_positions(Q_HOME, opening_m))
        plant.SetVelocities(context, np.zeros(plant.num_velocities()))
        plant.SetFreeBodyPose(context, self._object, self._X_SG @ RigidTransform(X_GO))
        self._place_table(_AWAY if X_GW is None else self._X_SG @ RigidTransform(X_GW))
        self._load(np.zeros(3))
        self._command(opening_m)
        self._simulator.Initialize()

    def place_fingers(self, opening_m: float) -> None:
        """Put the pads `opening_m` apart, at rest; nothing else moves."""
        positions = panda_positions(Q_HOME, opening_m)
        self._plant.SetPositions(self._plant_context, self._panda, positions)
        self._command(opening_m)

    def take_table_away(self) -> None:
        """Leave the object to the hand alone."""
        self._place_table(_AWAY)

    def advance(self, duration_s: float, opening_m: float, f_G: Array) -> None:
        """Simulate for a while.

        Args:
            duration_s: in which the command and the load stay as they are.
            opening_m: commanded distance between the pads; below 0 they squeeze.
            f_G: (3,) force in G at the object's centre of mass, N.

        Raises RuntimeError where Drake's contact solver fails.
        """
        self._command(opening_m)
        self._load(self._X_SG.rotation().matrix() @ f_G)
        self._simulator.AdvanceTo(self._context.get_time() + duration_s)

    @property
    def time_s(self) -> float:
        """Simulated time since `reset`."""
        return float(self._context.get_time())

    @property
    def X_GO(self) -> Array:
        """Where the object is, (4, 4)."""
        X_SO = self._plant.EvalBodyPoseInWorld(self._plant_context, self._object)
        return (self._X_SG.inverse() @ X_SO).GetAsMatrix4()

    @property
    def opening_m(self) -> float:
        """Distance between the pads."""
        return float(self._plant.GetPositions(self._plant_context, self._panda)[7:9].sum())

    def fingers_touching(self) -> int:
        """Return how many of the two fingers touch the object."""
        touching = contacts_of(self._plant, self._plant_context, self._object.index())
        return len({name for name, _ in touching} & set(FINGER_BODIES))

    def hand_penetration_m(self) -> float:
        """Return how deep the hand is in the object or the table, 0 where it touches neither."""
        others = {self.body.name, TABLE_BODY}
        return penetration_m(self._plant, self._plant_context, HAND_BODIES, others)

    def pad_penetration_m(self) -> float:
        """Return how deep a finger is in the object, 0 where neither is."""
        return penetration_m(self._plant, self._plant_context, FINGER_BODIES, {self.body.name})

    @property
    def _context(self) -> Context:
        return self._simulator.get_mutable_context()

    @property
    def _plant_context(self) -> Context:
        return self._plant.GetMyMutableContextFromRoot(self._context)

    def _command(self, opening_m: float) -> None:
        self._diagram.GetInputPort("arm").FixValue(self._context, np.r_[Q_HOME, np.zeros(8)])
        gripper = np.array([opening_m, MAX_FORCE_N])
        self._diagram.GetInputPort("gripper").FixValue(self._context, gripper)

    def _load(self, f_S: Array) -> None:
        load = ExternallyAppliedSpatialForce()
        load.body_index = self._object.index()
        load.p_BoBq_B = self.body.p_OCom
        load.F_Bq_W = SpatialForce(np.zeros(3), f_S)
        self._diagram.GetInputPort("load").FixValue(self._context, Value([load]))

    def _lock(self) -> None:
        """Keep the arm and the table where they are put."""
        for name in ARM_JOINTS:
            self._plant.GetJointByName(name).Lock(self._plant_context)
        self._table_joint.Lock(self._plant_context)

    def _place_table(self, X_SW: RigidTransform) -> None:
        self._plant.SetFreeBodyPose(self._plant_context, self._table, X_SW)


def _add_loose_table(plant: MultibodyPlant, config: StationConfig) -> RigidBody:
    """Add the station's table as a body that can be put anywhere; its frame is W."""
    instance = plant.AddModelInstance(TABLE_BODY)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 1.0)
    table = plant.AddRigidBody(TABLE_BODY, instance, inertia)
    primitive = table_primitive(config.layout)
    plant.RegisterCollisionGeometry(
        table,
        RigidTransform(primitive.X_OP),
        drake_shape(primitive),
        TABLE_BODY,
        CoulombFriction(1.0, 1.0),
    )
    return table


def _floating_joint(plant: MultibodyPlant, body: RigidBody) -> Joint:
    """Return the joint that leaves a free body all its freedom."""
    (index,) = plant.GetJointIndices(body.model_instance())
    return plant.get_joint(index)


def _let_only_the_hand_touch(
    plant: MultibodyPlant, scene_graph: SceneGraph, table: RigidBody
) -> None:
    """Exclude contacts of the arm, which no grasp has where it stands here, with the table."""
    arm = GeometrySet()
    for number in range(8):
        link = plant.GetBodyByName(f"panda_link{number}")
        arm.Add(plant.GetCollisionGeometriesForBody(link))
    tables = GeometrySet(plant.GetCollisionGeometriesForBody(table))
    declaration = CollisionFilterDeclaration().ExcludeBetween(arm, tables)
    scene_graph.collision_filter_manager().Apply(declaration)
