"""A table with objects and a free-floating hand: the world of clutter removal."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import FrameId, Meshcat
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from split_drake.camera import DepthView, Intrinsics
from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, check_poses
from split_drake.robot.arm_command import COMMAND_PERIOD_S, check_force
from split_drake.robot.gripper import MAX_FORCE_N, MAX_OPENING_M
from split_drake.robot.panda import FINGER_JOINTS, GRIPPER_FRAME, HAND_BODIES
from split_drake.station.cameras.depth_cameras import photograph
from split_drake.station.cameras.rendered_scene import add_rendered_scene, query_of
from split_drake.station.config import StationConfig
from split_drake.station.fixtures import add_objects, add_table
from split_drake.station.hand.fence import add_fence
from split_drake.station.hand.hand_command import add_hand_command, shares_of_way
from split_drake.station.hand.hand_model import HandModel, add_hand
from split_drake.station.hand.views import render_depth
from split_drake.station.layout import CameraPlacement, Layout
from split_drake.station.objects.loose_objects import (
    PARKED_Z_M,
    LooseObjects,
    free_joint,
    put_body,
)
from split_drake.station.objects.resting_points import let_objects_bear, with_resting_points
from split_drake.station.steps import add_meshcat, add_plant, set_contact_material

# As fast as VGN's hand.
SPEED_M_S = 0.1
# Both pads together.  Closing over 8 cm and squeezing with all the force takes 0.5 s.
CLOSING_SPEED_M_S = 0.2
SQUEEZE_M = -0.05


class HandStation:
    """One diagram, and its simulator, with a table, objects and a hand that floats above it.

    Input ports of the diagram: `gantry` (7,) and `gripper` (2,), see `add_hand_command`.

    To begin with, the table is empty: the hand and all objects are parked out of the way, and so
    is the fence.  What is parked stays where it is.  Objects' true poses are read through
    `split_drake.truth`.

    Attributes:
        config: contact, its numbers and the fingers' control, with the layout as given.
        objects: as given.
        plant: with model instances `gantry`, `panda` (the hand), `table`, `fence`, and one for
            each object.
        diagram: the whole.
        simulator: of the diagram, initialized.

    Raises ValueError where two objects have one name.
    """

    def __init__(
        self,
        objects: Sequence[RigidObject],
        layout: Layout,
        config: StationConfig | None = None,
        meshcat: Meshcat | None = None,
    ) -> None:
        self.config = replace(config or StationConfig(layout), layout=layout)
        self.objects = tuple(objects)
        builder = DiagramBuilder()
        self.plant, self._scene_graph = add_plant(builder, self.config)
        bearing = [with_resting_points(item) for item in self.objects]
        self._hand, table, self._fence, self._bodies = self._add_models(
            self.plant, bearing, visible=meshcat is not None
        )
        self._loose = LooseObjects(self.plant, self._bodies)
        set_contact_material(self.plant, self._scene_graph, self.config)
        self.plant.Finalize()
        let_objects_bear(self.plant, self._scene_graph, bearing, table)
        add_hand_command(builder, self.plant, self._hand, self.config.finger_kp_n_per_m)
        self._rendered_scene = add_rendered_scene(
            builder, self.plant, lambda plant: self._add_models(plant, self.objects, solid=False)
        )
        if meshcat is not None:
            add_meshcat(builder, self._scene_graph, meshcat, self.config)
        self.diagram = builder.Build()
        self.diagram.set_name("hand_station")
        self.simulator = Simulator(self.diagram)
        self.park_hand()
        self.take_fence_away()
        for index in range(len(self.objects)):
            self.park_object(index)
        self.simulator.Initialize()

    def _add_models(
        self,
        plant: MultibodyPlant,
        objects: Sequence[RigidObject],
        visible: bool = True,
        solid: bool = True,
    ) -> tuple[HandModel, RigidBody, RigidBody, tuple[RigidBody, ...]]:
        """Add all that the station is made of; return hand, table, fence and objects."""
        layout = self.config.layout
        hand = add_hand(plant, self.config)
        table = add_table(plant, layout)
        fence = add_fence(plant, layout.workspace)
        bodies = add_objects(plant, objects, visible, layout.table_z_m, solid)
        return hand, table, fence, bodies

    # What the hand is told.

    def place_hand(self, X_WG: ArrayLike, opening_m: float = MAX_OPENING_M) -> None:
        """Put the hand at rest at X_WG (4, 4), the pads `opening_m` apart, and hold it there."""
        X = check_poses(X_WG, "X_WG")
        if not 0.0 <= opening_m <= MAX_OPENING_M + 1e-9:
            raise ValueError(f"opening_m is {opening_m}; expected 0 to {MAX_OPENING_M}")
        context, model = self.plant_context, self._hand
        # Poses of a network are orthonormal to single precision only.
        R_WG = RotationMatrix.ProjectToRotationMatrix(X[:3, :3])
        self.plant.SetPositions(context, model.gantry, X[:3, 3])
        model.wrist.SetPose(context, RigidTransform(R_WG, np.zeros(3)))
        model.wrist.Lock(context)
        for joint in self._fingers():
            joint.set_translation(context, opening_m / 2.0)
        for instance in (model.gantry, model.hand):
            speeds = np.zeros(self.plant.num_velocities(instance))
            self.plant.SetVelocities(context, instance, speeds)
        self._command_gantry(X[:3, 3], np.zeros(3))
        self.grip(opening_m)

    def park_hand(self) -> None:
        """Put the opened hand out of the way."""
        self.place_hand(RigidTransform((-1.0, 0.0, PARKED_Z_M)).GetAsMatrix4())

    def grip(self, opening_m: float, force_n: float = MAX_FORCE_N) -> None:
        """Command the distance between the pads from now on.

        Args:
            opening_m: at most 0.08; below 0 the force limit acts.
            force_n: limit of each finger's force, at most 40.
        """
        if not opening_m <= MAX_OPENING_M + 1e-9:
            raise ValueError(f"opening_m is {opening_m}; expected at most {MAX_OPENING_M}")
        gripper = np.array([opening_m, check_force(force_n)])
        self.diagram.GetInputPort("gripper").FixValue(self._context, gripper)

    def move(
        self, p_WG: ArrayLike, speed_m_s: float = SPEED_M_S, stop_at_contact: bool = False
    ) -> bool:
        """Move the hand on a straight line, as it is turned and gripping what it grips.

        The hand falls behind where more than `hand_model.GANTRY_FORCE_N` along an axis of W holds
        it back.

        Args:
            p_WG: (3,) where G is to go.
            speed_m_s: on the way; at both ends it changes as fast as `shares_of_way` says.
            stop_at_contact: whether to stop as soon as the hand touches anything.

        Returns whether it went all the way: not, where it stopped at a contact.
        """
        target = np.asarray(p_WG, dtype=float)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise ValueError(f"p_WG is {p_WG!r}; expected 3 finite numbers")
        if not speed_m_s > 0.0:
            raise ValueError(f"speed_m_s is {speed_m_s}; expected more than 0")
        start, length_m = self._p_WDesired, float(np.linalg.norm(target - self._p_WDesired))
        if stop_at_contact and self.touching():
            return False
        shares = np.r_[0.0, shares_of_way(length_m, speed_m_s)]
        for share, following in pairwise(shares):
            velocity = (following - share) / COMMAND_PERIOD_S * (target - start)
            self._command_gantry(start + share * (target - start), velocity)
            self.advance(COMMAND_PERIOD_S)
            if stop_at_contact and self.touching():
                self._command_gantry(self.X_WG[:3, 3], np.zeros(3))
                return False
        self._command_gantry(target, np.zeros(3))
        return True

    def close(self, duration_s: float = 0.5, force_n: float = MAX_FORCE_N) -> None:
        """Close the hand on whatever is between the pads, for a while, and keep squeezing it."""
        opening_m = self.opening_m
        for _ in range(round(duration_s / COMMAND_PERIOD_S)):
            opening_m = max(SQUEEZE_M, opening_m - CLOSING_SPEED_M_S * COMMAND_PERIOD_S)
            self.grip(opening_m, force_n)
            self.advance(COMMAND_PERIOD_S)
        self.grip(SQUEEZE_M, force_n)

    def advance(self, duration_s: float) -> None:
        """Simulate for a while.

        Raises RuntimeError where Drake's contact solver fails.
        """
        self.simulator.AdvanceTo(self.time_s + duration_s)

    # What the hand measures.

    @property
    def time_s(self) -> float:
        return float(self._context.get_time())

    @property
    def X_WG(self) -> Array:
        """Where the hand is, (4, 4)."""
        frame = self.plant.GetFrameByName(GRIPPER_FRAME)
        return frame.CalcPoseInWorld(self.plant_context).GetAsMatrix4()

    @property
    def opening_m(self) -> float:
        """Distance between the pads."""
        return float(sum(joint.get_translation(self.plant_context) for joint in self._fingers()))

    @property
    def gantry_force_n(self) -> Array:
        """What the gantry exerted on the hand in the last step, (3,) in W."""
        port = self.plant.get_net_actuation_output_port(self._hand.gantry)
        return port.Eval(self.plant_context)

    def touching(self) -> frozenset[str]:
        """Return the names of the bodies that the hand touches now."""
        hand = {self._frame_id(self.plant.GetBodyByName(name)) for name in HAND_BODIES}
        inspector, found = self._scene_graph.model_inspector(), set()
        for pair in query_of(self._scene_graph, self._context).ComputePointPairPenetration():
            ends = {inspector.GetFrameId(pair.id_A), inspector.GetFrameId(pair.id_B)}
            if ends & hand:
                found |= ends - hand
        return frozenset(self.plant.GetBodyFromFrameId(frame).name() for frame in found)

    def capture(self, cameras: Sequence[CameraPlacement]) -> tuple[DepthView, ...]:
        """Return what depth cameras at these places see now, wherever they are."""
        query = query_of(self._rendered_scene, self._context)
        return tuple(render_depth(query, placement) for placement in cameras)

    # Setting up.

    @property
    def present(self) -> tuple[int, ...]:
        """Which objects are not parked, in order."""
        return self._loose.present

    def place_object(self, index: int, X_WO: ArrayLike) -> None:
        """Put object `index` at rest at X_WO (4, 4), free to move.

        Raises ValueError where it was discarded.
        """
        self._loose.place(self.plant_context, index, X_WO)

    def park_object(self, index: int) -> None:
        """Take object `index` out of the way, wherever it is."""
        self._loose.park(self.plant_context, index)

    def discard_parked(self) -> None:
        """Forget the objects that are parked, which cannot be placed again.

        Parked ones cost time in every step: seven of twelve a third of it.
        """
        geometry_context = self._scene_graph.GetMyMutableContextFromRoot(self._context)
        self._loose.discard_parked(self._scene_graph, geometry_context)

    def put_fence_up(self) -> None:
        """Put walls around the workspace."""
        self._put_fence(self.config.layout.workspace.p_WCenter)

    def take_fence_away(self) -> None:
        """Leave the workspace without walls."""
        self._put_fence((0.0, 0.0, 2.0 * PARKED_Z_M))

    # For looking at it.

    @property
    def plant_context(self) -> Context:
        """The plant's context, whose state is the simulator's truth."""
        return self.plant.GetMyMutableContextFromRoot(self._context)

    def object_body(self, index: int) -> BodyIndex:
        """Return the plant's index of object `index`."""
        return self._bodies[index].index()

    def photograph(self, intrinsics: Intrinsics, X_WC: Array) -> NDArray[np.uint8]:
        """Return an (H, W, 3) colour picture of the station from a camera at X_WC."""
        return photograph(query_of(self._rendered_scene, self._context), intrinsics, X_WC)

    @property
    def _context(self) -> Context:
        return self.simulator.get_mutable_context()

    def _fingers(self) -> list[Joint]:
        return [self.plant.GetJointByName(name, self._hand.hand) for name in FINGER_JOINTS]

    def _put_fence(self, p_WFence: tuple[float, float, float]) -> None:
        put_body(self.plant, self.plant_context, self._fence, RigidTransform(p_WFence))
        free_joint(self.plant, self._fence).Lock(self.plant_context)

    def _command_gantry(self, p_WG: Array, v_WG: Array) -> None:
        self._p_WDesired = p_WG
        command = np.r_[p_WG, v_WG, self.time_s]
        self.diagram.GetInputPort("gantry").FixValue(self._context, command)

    def _frame_id(self, body: RigidBody) -> FrameId:
        return self.plant.GetBodyFrameIdOrThrow(body.index())
