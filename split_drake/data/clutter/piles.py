"""Piles of objects by physics: dropped one by one, each time until all is at rest."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from split_drake.data.clutter.arrangements import Arrangement
from split_drake.data.clutter.library import ClutterObject
from split_drake.poses import Array, make_pose
from split_drake.station.config import StationConfig
from split_drake.station.fixtures import add_objects, add_table
from split_drake.station.steps import add_plant, set_contact_material

# Objects fall from here, within this distance of the workspace's middle along x and y.
DROP_HEIGHT_M, DROP_SPREAD_M = 0.2, 0.05
# A drop is watched in steps until all is slow, and no longer than this.
STEP_S, LONGEST_S = 0.1, 1.0
SLOW_M_S, SLOW_RAD_S = 0.02, 0.3
# Where objects wait, each a metre from the next: on nothing, so they are held at rest.
_WAITING_Z_M = -50.0


class PileSimulator:
    """The table, and objects that fall on it one after the other.

    Args:
        objects: of the pile; one may be there several times.
        config: contact and layout.
    """

    def __init__(self, objects: Sequence[ClutterObject], config: StationConfig) -> None:
        self._center = np.array(config.layout.workspace.p_WCenter)
        self._workspace = config.layout.workspace
        builder = DiagramBuilder()
        self._plant, scene_graph = add_plant(builder, config)
        add_table(self._plant, config.layout)
        named = [
            replace(each.body, name=f"{each.body.name}#{number}")
            for number, each in enumerate(objects)
        ]
        self._bodies = add_objects(self._plant, named, False, config.layout.table_z_m)
        set_contact_material(self._plant, scene_graph, config)
        self._plant.Finalize()
        self._simulator = Simulator(builder.Build())
        self._context = self._plant.GetMyMutableContextFromRoot(
            self._simulator.get_mutable_context()
        )
        self._joints = [
            self._plant.get_joint(self._plant.GetJointIndices(body.model_instance())[0])
            for body in self._bodies
        ]
        for number in range(len(self._bodies)):
            self._park(number)

    def drop_all(self, rng: np.random.Generator) -> Iterator[Arrangement]:
        """Drop one object after the other, and yield how all lie after each of them.

        What has left the workspace is parked again and no longer there.

        Raises RuntimeError where Drake's contact solver fails.
        """
        there: list[int] = []
        for number in range(len(self._bodies)):
            offset = (*rng.uniform(-DROP_SPREAD_M, DROP_SPREAD_M, 2), DROP_HEIGHT_M)
            R_WO = Rotation.from_quat(rng.normal(size=4)).as_matrix()
            self._joints[number].Unlock(self._context)
            self._place(number, make_pose(R_WO, self._center + np.array(offset)))
            there.append(number)
            self._wait(there)
            for each in [n for n in there if not self._inside(self._pose(n))]:
                self._park(each)
                there.remove(each)
            if there:
                poses = np.stack([self._pose(each) for each in there])
                yield Arrangement(tuple(there), poses)

    def _wait(self, there: Sequence[int]) -> None:
        end_s = self._simulator.get_context().get_time() + LONGEST_S
        while (time_s := self._simulator.get_context().get_time()) < end_s - 1e-9:
            self._simulator.AdvanceTo(time_s + STEP_S)
            if all(self._slow(number) for number in there):
                return

    def _slow(self, number: int) -> bool:
        V_WO = self._plant.EvalBodySpatialVelocityInWorld(self._context, self._bodies[number])
        return bool(
            np.linalg.norm(V_WO.translational()) < SLOW_M_S
            and np.linalg.norm(V_WO.rotational()) < SLOW_RAD_S
        )

    def _pose(self, number: int) -> Array:
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._bodies[number])
        return pose.GetAsMatrix4()

    def _inside(self, X_WO: Array) -> bool:
        offset = X_WO[:3, 3] - self._center
        half_m = self._workspace.edge_m / 2.0 - 0.02
        return bool(np.all(np.abs(offset[:2]) < half_m) and offset[2] > -0.02)

    def _park(self, number: int) -> None:
        self._place(number, make_pose(p=(float(number), 0.0, _WAITING_Z_M)))
        self._joints[number].Lock(self._context)

    def _place(self, number: int, X_WO: Array) -> None:
        body = self._bodies[number]
        self._plant.SetFreeBodyPose(self._context, body, RigidTransform(X_WO))
        self._plant.SetFreeBodySpatialVelocity(
            context=self._context, body=body, V_JpJc=SpatialVelocity.Zero()
        )
