"""The robot model against published kinematics, the gripper's boxes, and the cameras' views."""

import numpy as np
import pytest
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import Sphere
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.robot.gripper import (
    FLANGE_TO_GRIPPER_M,
    MAX_FORCE_N,
    MAX_OPENING_M,
    PALM,
    Box,
    finger_boxes,
)
from split_drake.robot.panda import (
    FINGER_BODIES,
    FINGER_JOINTS,
    GRIPPER_FRAME,
    add_panda,
    arm_limits,
    panda_positions,
)
from split_drake.robot.posture import Q_HOME
from split_drake.scene import EmptySceneError, Scene, Workspace
from split_drake.station.station import Station
from tests.helpers.stations import STATION

# (a, alpha, d) of the published modified Denavit-Hartenberg parameters.
DH = (
    (0.0, 0.0, 0.333),
    (0.0, -np.pi / 2, 0.0),
    (0.0, np.pi / 2, 0.316),
    (0.0825, np.pi / 2, 0.0),
    (-0.0825, -np.pi / 2, 0.384),
    (0.0, np.pi / 2, 0.0),
    (0.088, np.pi / 2, 0.0),
)


class Model:
    """The Panda alone, with its collision geometry."""

    def __init__(self) -> None:
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
        add_panda(self.plant)
        self.plant.Finalize()
        self._diagram: Diagram = builder.Build()
        self._root = self._diagram.CreateDefaultContext()
        self.context: Context = self.plant.GetMyMutableContextFromRoot(self._root)

    def set_arm(self, q: Array, opening_m: float) -> None:
        self.plant.SetPositions(self.context, panda_positions(q, opening_m))

    def bounds_in_gripper(self, body_name: str) -> dict[str, Box]:
        """Return the bounds in G of each collision box and sphere of a body, by name."""
        gripper = self.plant.GetFrameByName(GRIPPER_FRAME)
        body = self.plant.GetBodyByName(body_name)
        X_GB = body.body_frame().CalcPose(self.context, gripper)
        bounds = {}
        inspector = self.scene_graph.model_inspector()
        for geometry in self.plant.GetCollisionGeometriesForBody(body):
            X_GP = X_GB.multiply(inspector.GetPoseInFrame(geometry))
            np.testing.assert_allclose(X_GP.rotation().matrix(), np.eye(3), atol=1e-9)
            half = _half_extents(inspector.GetShape(geometry))
            center = X_GP.translation()
            name = inspector.GetName(geometry).split("::")[-1]
            bounds[name] = Box(tuple(center - half), tuple(center + half))
        return bounds

    def penetrations(self) -> list[float]:
        port = self.scene_graph.get_query_output_port()
        query = port.Eval(self.scene_graph.GetMyContextFromRoot(self._root))
        return [pair.depth for pair in query.ComputePointPairPenetration()]


def _half_extents(shape: DrakeBox | Sphere) -> Array:
    if isinstance(shape, Sphere):
        return np.full(3, shape.radius())
    return np.asarray(shape.size()) / 2.0


@pytest.fixture(scope="module")
def model() -> Model:
    return Model()


def _published_gripper_pose(q: Array) -> Array:
    X_WG = np.eye(4)
    for angle, (a, alpha, d) in zip(q, DH, strict=True):
        X_WG = X_WG @ make_pose(rotation_x(alpha), (a, 0.0, 0.0))
        X_WG = X_WG @ make_pose(rotation_z(angle), (0.0, 0.0, d))
    return X_WG @ make_pose(rotation_z(-np.pi / 4), (0.0, 0.0, FLANGE_TO_GRIPPER_M))


def test_gripper_frame_follows_the_published_kinematics(model: Model) -> None:
    limits, rng = arm_limits(), np.random.default_rng(0)
    for q in rng.uniform(limits.q_lower, limits.q_upper, (20, 7)):
        model.set_arm(q, 0.04)
        X_WG = model.plant.GetFrameByName(GRIPPER_FRAME).CalcPoseInWorld(model.context)
        np.testing.assert_allclose(
            X_WG.GetAsMatrix4(), _published_gripper_pose(q), atol=1e-12, rtol=0
        )


def test_limits_are_the_published_ones() -> None:
    limits = arm_limits()
    np.testing.assert_allclose(limits.q_lower[[0, 1, 3, 5]], [-2.8973, -1.7628, -3.0718, -0.0175])
    np.testing.assert_allclose(limits.q_upper[[0, 1, 3, 5]], [2.8973, 1.7628, -0.0698, 3.7525])
    np.testing.assert_allclose(limits.v_max, [2.175] * 4 + [2.61] * 3)
    np.testing.assert_allclose(limits.a_max, [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
    np.testing.assert_allclose(limits.effort_max_nm, [87.0] * 4 + [12.0] * 3)


def test_fingers_have_the_grippers_range_and_force(model: Model) -> None:
    for name in FINGER_JOINTS:
        joint = model.plant.GetJointByName(name)
        assert joint.position_upper_limit() == MAX_OPENING_M / 2.0
        assert model.plant.GetJointActuatorByName(name).effort_limit() == MAX_FORCE_N


@pytest.mark.parametrize("opening_m", [0.0, 0.033, MAX_OPENING_M])
def test_collision_boxes_are_those_of_the_gripper(model: Model, opening_m: float) -> None:
    model.set_arm(Q_HOME, opening_m)
    left_pad, right_pad, left_stem, right_stem = finger_boxes(opening_m)
    _assert_same_box(model.bounds_in_gripper("panda_hand")["palm"], PALM)
    for body, pad, stem in zip(
        FINGER_BODIES, (left_pad, right_pad), (left_stem, right_stem), strict=True
    ):
        bounds = model.bounds_in_gripper(body)
        _assert_same_box(bounds.pop("stem"), stem)
        assert len(bounds) == 10, "a pad is one box and nine spheres"
        lower = np.min([bound.lower for bound in bounds.values()], axis=0)
        upper = np.max([bound.upper for bound in bounds.values()], axis=0)
        _assert_same_box(Box(tuple(lower), tuple(upper)), pad)


def _assert_same_box(actual: Box, expected: Box) -> None:
    np.testing.assert_allclose(actual.lower, expected.lower, atol=1e-9)
    np.testing.assert_allclose(actual.upper, expected.upper, atol=1e-9)


def test_home_is_within_limits_and_free_of_self_collision(model: Model) -> None:
    limits = arm_limits()
    assert np.all((limits.q_lower + 0.1 < Q_HOME) & (limits.q_upper - 0.1 > Q_HOME))
    model.set_arm(Q_HOME, MAX_OPENING_M)
    assert model.penetrations() == []


def test_self_collision_is_noticed(model: Model) -> None:
    model.set_arm(np.array([0.0, -1.7, 0.0, -3.0, 0.0, 0.5, 0.0]), MAX_OPENING_M)
    assert max(model.penetrations()) > 0.01


def test_arm_at_home_is_invisible_in_the_workspace() -> None:
    with pytest.raises(EmptySceneError):
        Scene.from_views(Station(STATION).capture(), Workspace())


@pytest.mark.parametrize(("q", "opening_m"), [(np.zeros(6), 0.04), (np.zeros(7), 0.09)])
def test_impossible_positions_are_refused(q: Array, opening_m: float) -> None:
    with pytest.raises(ValueError, match="expected"):
        panda_positions(q, opening_m)
