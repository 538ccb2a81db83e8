"""The simulated station: a Panda at a table with a hook, objects, and depth cameras."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder

from split_drake.camera import DepthView, Intrinsics
from split_drake.depth_noise import DEPTH_NOISE
from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array
from split_drake.robot.arm_command import check_force
from split_drake.robot.gripper import MAX_FORCE_N, MAX_OPENING_M
from split_drake.robot.panda import add_panda, panda_positions
from split_drake.sensing.depth_filter import DepthFilter
from split_drake.station.cameras.depth_cameras import add_depth_camera, depth_view, photograph
from split_drake.station.cameras.rendered_scene import add_rendered_scene, query_of
from split_drake.station.config import StationConfig
from split_drake.station.detector_system import PoseDetectorSystem
from split_drake.station.fixtures import add_bin, add_hook, add_objects, add_scenery, add_table
from split_drake.station.layout import Layout
from split_drake.station.objects.loose_objects import LooseObjects
from split_drake.station.objects.resting_points import let_objects_bear, with_resting_points
from split_drake.station.steps import (
    add_command,
    add_detector,
    add_logs,
    add_meshcat,
    add_plant,
    export_state,
    set_actuator_gains,
    set_contact_material,
)


class Station:
    """One diagram with named ports, and its simulator.

    Input ports of the diagram: `arm` (15,) and `gripper` (2,), see `arm_command_system`.  Output
    ports: `<camera>.depth_image`, `panda_state` (18,), `panda_torques` (9,), and with a detector
    `scene` and `pose_sets`.  The cameras cost nothing until they are read.

    What a real robot would measure is read here; the objects' true poses are not: see
    `split_drake.truth`.

    Attributes:
        config: as given.
        objects: as given.
        plant: with model instances `panda`, `table`, `hook`, `bin` where the layout has one, and
            one for each object.
        diagram: the whole.
        simulator: of the diagram, initialized.

    Args:
        sensor_rng: what the depth cameras' noise is drawn from, where the configuration has any.
        logged: whether what the robot measures in every step is kept for `take_log`.
        bearing: whether objects stand on the table by points at their hulls' corners, as in clutter
            (`split_drake.station.objects.resting_points`), or by their collision pieces.
    """

    def __init__(
        self,
        config: StationConfig,
        objects: Sequence[RigidObject] = (),
        meshcat: Meshcat | None = None,
        detector_system: PoseDetectorSystem | None = None,
        bearing: bool = False,
        sensor_rng: np.random.Generator | None = None,
        logged: bool = False,
    ) -> None:
        self.config = config
        self._noise, self._sensor_rng = DEPTH_NOISE[config.depth_noise], sensor_rng
        if self._noise is not None and sensor_rng is None:
            raise ValueError(f"depth_noise is {config.depth_noise!r}; it needs a sensor_rng")
        self.objects = tuple(objects)
        layout = self.config.layout
        builder = DiagramBuilder()
        self.plant, self._scene_graph = add_plant(builder, self.config)
        added = tuple(map(with_resting_points, self.objects)) if bearing else self.objects
        self._panda, table, self._bodies = _add_models(
            self.plant, layout, added, visible=meshcat is not None
        )
        set_actuator_gains(self.plant, self._panda, self.config)
        self._loose = LooseObjects(self.plant, self._bodies)
        set_contact_material(self.plant, self._scene_graph, self.config)
        self.plant.Finalize()
        if bearing:
            let_objects_bear(self.plant, self._scene_graph, added, table)
        add_command(builder, self.plant, self._panda, self.config)
        export_state(builder, self.plant, self._panda)
        self._sinks = add_logs(builder, self.plant, self._panda) if logged else ()
        self._rendered_scene = add_rendered_scene(
            builder,
            self.plant,
            lambda plant: _add_models(plant, layout, self.objects, solid=False),
        )
        self._cameras = [
            add_depth_camera(builder, self._rendered_scene, camera) for camera in layout.cameras
        ]
        if detector_system is not None:
            add_detector(builder, detector_system, self._cameras)
        if meshcat is not None:
            add_meshcat(builder, self._scene_graph, meshcat, self.config)
        self.diagram = builder.Build()
        self.diagram.set_name("station")
        self._state_port = self.diagram.GetOutputPort("panda_state")
        self._torque_port = self.diagram.GetOutputPort("panda_torques")
        self.simulator = Simulator(self.diagram)
        self.set_arm(layout.q_home, MAX_OPENING_M)
        self.simulator.Initialize()

    # What the robot is told.

    def command(self, q: ArrayLike, v: ArrayLike, opening_m: float, force_n: float) -> None:
        """Set the desired state from now to the next command.

        Args:
            q, v: (7,) joint angles now, rad, and velocities, rad/s, at which they move on for the
                next 10 ms; then they rest.
            opening_m: distance between the pads, at most 0.08; below 0 the force limit acts.
            force_n: limit of each finger's force, at most 40.
        """
        arm = np.concatenate([np.asarray(q, float), np.asarray(v, float)])
        if arm.shape != (14,) or not np.isfinite(arm).all():
            raise ValueError(f"q and v are {q!r} and {v!r}; expected 7 finite numbers each")
        if not opening_m <= MAX_OPENING_M + 1e-9:
            raise ValueError(f"opening_m is {opening_m}; expected at most {MAX_OPENING_M}")
        self.diagram.GetInputPort("arm").FixValue(self._context, np.append(arm, self.time_s))
        gripper = np.array([opening_m, check_force(force_n)])
        self.diagram.GetInputPort("gripper").FixValue(self._context, gripper)

    def advance(self, duration_s: float) -> None:
        """Simulate for a while.

        Raises RuntimeError where Drake's contact solver fails.
        """
        self.simulator.AdvanceTo(self.time_s + duration_s)

    # What the robot measures.

    @property
    def time_s(self) -> float:
        return float(self._context.get_time())

    @property
    def q(self) -> Array:
        """Joint angles, (7,) in rad."""
        return self.panda_state[:7]

    @property
    def v(self) -> Array:
        """Joint velocities, (7,) in rad/s."""
        return self.panda_state[9:16]

    @property
    def opening_m(self) -> float:
        """Distance between the pads."""
        return float(self.panda_state[7:9].sum())

    @property
    def joint_torques_nm(self) -> Array:
        """Torques of the arm's actuators in the last step, (7,), without the arm's own weight."""
        return self._torque_port.Eval(self._context)[:7]

    @property
    def finger_forces_n(self) -> Array:
        """Forces of the fingers' actuators in the last step, (2,), negative where they close."""
        return self._torque_port.Eval(self._context)[7:]

    @property
    def panda_state(self) -> Array:
        """Positions (9,), then velocities (9,), of the seven joints and both fingers."""
        return self._state_port.Eval(self._context)

    def take_log(self) -> tuple[Array, Array]:
        """Return `panda_state` (N, 18) and joint torques (N, 7) of the steps since the last call.

        Raises RuntimeError where the station is not `logged`.
        """
        if not self._sinks:
            raise RuntimeError("the station keeps no log; make it with logged=True")
        logs = [sink.FindMutableLog(self._context) for sink in self._sinks]
        states, torques = (log.data().T.copy() for log in logs)
        for log in logs:
            log.Clear()
        return states, torques[:, :7]

    def capture(self) -> tuple[DepthView, ...]:
        """Return what the depth cameras see now, in the layout's order."""
        views = []
        for camera, placement in zip(self._cameras, self.config.layout.cameras, strict=True):
            port = camera.depth_image_32F_output_port()
            image = port.Eval(camera.GetMyContextFromRoot(self._context))
            views.append(self._as_seen(depth_view(image, placement)))
        return tuple(views)

    def _as_seen(self, view: DepthView) -> DepthView:
        """Return a view with the noise of the cameras, smoothed as their drivers do."""
        if self._noise is None or self._sensor_rng is None:
            return view
        return DepthFilter().seen(self._noise.seen(view, self._sensor_rng))

    # Setting up.

    def set_arm(self, q: ArrayLike, opening_m: float) -> None:
        """Put the arm at rest at `q` (7,), the pads `opening_m` apart, and command it to stay."""
        positions = panda_positions(np.asarray(q, float), opening_m)
        self.plant.SetPositions(self.plant_context, self._panda, positions)
        self.plant.SetVelocities(self.plant_context, self._panda, np.zeros(9))
        self.command(q, np.zeros(7), opening_m, MAX_FORCE_N)

    @property
    def present(self) -> tuple[int, ...]:
        """Which objects are not parked, in order."""
        return self._loose.present

    def place_object(self, index: int, X_WO: ArrayLike) -> None:
        """Put object `index` at rest at X_WO (4, 4)."""
        self._loose.place(self.plant_context, index, X_WO)

    def park_object(self, index: int) -> None:
        """Take object `index` out of the way, wherever it is."""
        self._loose.park(self.plant_context, index)

    # For looking at it.

    @property
    def plant_context(self) -> Context:
        """The plant's context, whose state is the simulator's truth."""
        return self.plant.GetMyMutableContextFromRoot(self._context)

    @property
    def _context(self) -> Context:
        return self.simulator.get_mutable_context()

    def object_body(self, index: int) -> BodyIndex:
        """Return the plant's index of object `index`."""
        return self._bodies[index].index()

    def photograph(self, intrinsics: Intrinsics, X_WC: Array) -> NDArray[np.uint8]:
        """Return an (H, W, 3) colour picture of the station from a camera at X_WC."""
        return photograph(query_of(self._rendered_scene, self._context), intrinsics, X_WC)

    def graphviz(self) -> str:
        """Return the diagram's systems and connections in Graphviz' language."""
        return self.diagram.GetGraphvizString(max_depth=1)


def _add_models(
    plant: MultibodyPlant,
    layout: Layout,
    objects: Sequence[RigidObject],
    visible: bool = True,
    solid: bool = True,
) -> tuple[ModelInstanceIndex, RigidBody, tuple[RigidBody, ...]]:
    """Add all that a station is made of; return the Panda, the table and the objects."""
    panda = add_panda(plant)
    add_scenery(plant, layout)
    table = add_table(plant, layout)
    add_hook(plant, layout)
    add_bin(plant, layout)
    return panda, table, add_objects(plant, objects, visible, layout.table_z_m, solid)
