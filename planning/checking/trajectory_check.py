"""The independent check of plans: every segment again, at a finer step, by Drake's own geometry.

Shares with the planner only the definition of the exemptions.  Forward kinematics, distances and
collisions come from a MultibodyPlant's QueryObject; the planner has its own in numpy.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import GeometryId, QueryObject, SignedDistanceToPoint
from pydrake.planning import RobotDiagramBuilder
from scipy.spatial import cKDTree

from planning.checking.violation import Violation
from planning.collision.exemptions import (
    MAX_LOWERING_M,
    MAX_PEG_DEPTH_M,
    MAX_TABLE_DEPTH_M,
    TABLE_LIFT_M,
    clear_of_palm,
    peg_tube,
)
from planning.problem import SAMPLE_S, JointTrajectory, Plan, Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.panda import (
    FINGER_BODIES,
    GRIPPER_FRAME,
    HAND_BODIES,
    add_panda,
    arm_limits,
    panda_positions,
)
from split_drake.station.fixtures import HOOK_BODY, TABLE_BODY, add_bin, add_hook, add_table
from split_drake.station.layout import Layout

STEP_RAD = 0.005
# Nearer than this, a point of the object counts as touching; the planner keeps further away.
TOUCH_M = 0.003
# Segments join, and limits hold, to this precision (rad, rad/s).
TOLERANCE = 1e-6
# Velocities are those at which the angles change between samples, but for this much (rad/s), as
# the root of the mean square over a segment.
VELOCITY_TOLERANCE = 0.02
# Sharp corners of a path take more than the acceleration that a joint is rated for, for less than a
# sample: up to twice, as timed by Toppra, in nearly all plans.  More than this factor is refused.
CORNER_FACTOR = 4.0
# FINGERS_TARGET is declared for this stretch at most before the grasp and after the release.
FINGER_STRETCH_M = 0.08 + 1e-4
# What is next to the held object by construction.
_HOLDERS = (*HAND_BODIES, "panda_link7")


class TrajectoryChecker:
    """Checks plans for a layout.

    Attributes:
        layout: of the static station.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        builder = RobotDiagramBuilder(time_step=0.001)
        plant = builder.plant()
        self._panda = add_panda(plant)
        add_table(plant, layout)
        add_hook(plant, layout)
        add_bin(plant, layout)
        self._diagram = builder.Build()
        self._plant = plant
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)
        self._gripper = plant.GetFrameByName(GRIPPER_FRAME)
        self._inspector = self._diagram.scene_graph().model_inspector()
        hook = plant.GetBodyByName(HOOK_BODY)
        self._peg = plant.GetCollisionGeometriesForBody(hook)[0]

    def violations(
        self, plan: Plan, p_WPs: Array, p_WObstacles: Array | None = None
    ) -> list[Violation]:
        """Return what is wrong with the plan; empty where nothing is.

        Args:
            plan: to be checked.
            p_WPs: (N, 3) points on the object's surface before the pick.  Those at the palm of a
                hand that holds the object as the plan begins may touch it.
            p_WObstacles: (O, 3) points on the surfaces of other things, which nothing may touch.
        """
        others = np.empty((0, 3)) if p_WObstacles is None else p_WObstacles
        X_WGrasp, X_WGRelease = self._gripper_ends(plan)
        if not plan.pick:
            p_WPs = p_WPs[clear_of_palm(X_WGrasp, p_WPs)]
        tubes = {
            felt: peg_tube(p_WPs, plan.X_WObject, plan.X_WGoal, MAX_LOWERING_M * felt)
            for felt in (False, True)
        }
        p_GPs = transform_points(invert_pose(X_WGrasp), p_WPs)
        found = list(_kinematic_violations(plan))
        picked = False
        for number, segment in enumerate(plan.segments):
            picked |= segment.holding
            X_WGEnd = X_WGRelease if picked else X_WGrasp
            standing = transform_points(X_WGEnd, p_GPs)
            points = p_GPs if segment.holding else standing
            what = self._first_contact(segment, points, tubes[segment.stop_on_contact], others)
            what = what or self._first_far_exemption(segment, X_WGEnd[:3, 3])
            what = what or _unfelt_table(segment)
            if what:
                found.append(Violation(number, segment.name, what))
        return found

    def _gripper_ends(self, plan: Plan) -> tuple[Array, Array]:
        """Return X_WG where the object is taken and where it is let go."""
        holding = [segment for segment in plan.segments if segment.holding]
        if not holding:
            raise ValueError("no segment of the plan holds the object; expected a pick and place")
        ends = (holding[0].trajectory.qs[0], holding[-1].trajectory.qs[-1])
        grasp, release = (self._pose_at(q) for q in ends)
        return grasp, release

    def _pose_at(self, q: Array) -> Array:
        self._query(q, 0.0)
        return np.asarray(self._gripper.CalcPoseInWorld(self._plant_context).GetAsMatrix4())

    def _query(self, q: Array, opening_m: float) -> QueryObject:
        positions = panda_positions(q, opening_m)
        self._plant.SetPositions(self._plant_context, self._panda, positions)
        return self._plant.get_geometry_query_input_port().Eval(self._plant_context)

    def _first_contact(
        self, segment: Segment, points: Array, exempt: NDArray[np.bool_], p_WObstacles: Array
    ) -> str:
        """Return the first undeclared contact of a segment, or an empty string.

        `points` (N, 3) are in G where the object is held, else in W.
        """
        others = cKDTree(p_WObstacles)
        openings = {float(np.clip(m, 0.0, MAX_OPENING_M)) for m in segment.openings_m}
        z_WGStart = self._pose_at(segment.trajectory.qs[0])[2, 3]
        for q, opening_m in product(fine_steps(segment.trajectory.qs), openings):
            X_WG = self._pose_at(q)
            p_WPs = transform_points(X_WG, points) if segment.holding else points
            low = X_WG[2, 3] - z_WGStart <= TABLE_LIFT_M
            query = self._query(q, opening_m)
            what = self._overlap(query) or self._touched(query, segment, p_WPs, exempt, low)
            what = what or self._robot_beside(query, p_WObstacles)
            if segment.holding:
                what = what or _held_beside(p_WPs, others)
            if what:
                return f"{what} at q = {np.round(q, 3)}"
        return ""

    def _overlap(self, query: QueryObject) -> str:
        """Return which bodies of robot and station overlap, or an empty string."""
        for pair in query.ComputePointPairPenetration():
            bodies = " and ".join(self._body(i) for i in (pair.id_A, pair.id_B))
            return f"{bodies} overlap by {1e3 * pair.depth:.1f} mm"
        return ""

    def _touched(
        self,
        query: QueryObject,
        segment: Segment,
        p_WPs: Array,
        exempt: NDArray[np.bool_],
        low: bool,
    ) -> str:
        """Return what the object (N, 3) touches undeclared, or an empty string.

        `exempt` (N,) marks the points in the peg's tube; `low`: the hand is no more than
        `TABLE_LIFT_M` above the segment's start.
        """
        for point, spared in zip(p_WPs, exempt, strict=True):
            on_table = low and point[2] > self.layout.table_z_m - MAX_TABLE_DEPTH_M
            for hit in query.ComputeSignedDistanceToPoint(point, TOUCH_M):
                if not self._declared(hit, segment, bool(spared), on_table):
                    return f"the object is {1e3 * hit.distance:.1f} mm from {self._body(hit.id_G)}"
        return ""

    def _robot_beside(self, query: QueryObject, p_WObstacles: Array) -> str:
        """Return what of the robot touches another thing (O, 3), or an empty string."""
        for point in p_WObstacles:
            for hit in query.ComputeSignedDistanceToPoint(point, TOUCH_M):
                body = self._body(hit.id_G)
                if body.startswith("panda"):
                    return f"{body} is {1e3 * hit.distance:.1f} mm from another thing"
        return ""

    def _declared(
        self, hit: SignedDistanceToPoint, segment: Segment, spared: bool, on_table: bool
    ) -> bool:
        """Return whether the object may touch a geometry as it does.

        Args:
            hit: a point of the object near a geometry.
            segment: under way.
            spared: whether HELD_PEG exempts the point.
            on_table: whether HELD_TABLE exempts the point.
        """
        body, contacts = self._body(hit.id_G), segment.allowed_contacts
        if not segment.holding:
            fingers = body in FINGER_BODIES and AllowedContact.FINGERS_TARGET in contacts
            return fingers or body in (TABLE_BODY, HOOK_BODY)
        if body == TABLE_BODY:
            return AllowedContact.HELD_TABLE in contacts and on_table
        if hit.id_G == self._peg:
            beside = segment.stop_on_contact or hit.distance > -MAX_PEG_DEPTH_M
            return AllowedContact.HELD_PEG in contacts and spared and beside
        return body in _HOLDERS

    def _first_far_exemption(self, segment: Segment, p_WEnd: Array) -> str:
        """Return where FINGERS_TARGET is declared too far from the grasp or the release."""
        if AllowedContact.FINGERS_TARGET not in segment.allowed_contacts:
            return ""
        ends = [self._pose_at(q)[:3, 3] for q in segment.trajectory.qs[[0, -1]]]
        distance = max(float(np.linalg.norm(p - p_WEnd)) for p in ends)
        if distance <= FINGER_STRETCH_M:
            return ""
        return f"fingers_target is declared {distance:.3f} m from the object's place"

    def _body(self, geometry: GeometryId) -> str:
        frame = self._inspector.GetFrameId(geometry)
        return str(self._plant.GetBodyFromFrameId(frame).name())


def _held_beside(p_WPs: Array, others: cKDTree) -> str:
    """Return that held points (N, 3) touch another thing, or an empty string."""
    nearest = np.asarray(others.query(p_WPs, distance_upper_bound=TOUCH_M)[0]).min(initial=np.inf)
    if not np.isfinite(nearest):
        return ""
    return f"the object is {1e3 * nearest:.1f} mm from another thing"


def _unfelt_table(segment: Segment) -> str:
    """Return that HELD_TABLE is declared for a motion that neither lifts nor feels the table."""
    felt = segment.stop_on_contact or not segment.holding or segment.name is SegmentName.LIFT
    if felt or AllowedContact.HELD_TABLE not in segment.allowed_contacts:
        return ""
    return "held_table is declared but the arm would not stop on contact"


def fine_steps(qs: Array) -> Iterator[Array]:
    """Yield points (7,) along a path (T, 7), no joint moving further than `STEP_RAD` between."""
    last = qs[0]
    yield last
    for q in qs[1:]:
        travel = float(np.abs(q - last).max())
        if travel < TOLERANCE:
            continue
        count = int(np.ceil(travel / STEP_RAD))
        for part in range(1, count + 1):
            yield last + (q - last) * (part / count)
        last = q


def _kinematic_violations(plan: Plan) -> Iterator[Violation]:
    """Yield where segments do not join, or move as the arm cannot."""
    end = plan.segments[0].trajectory.qs[0]
    for number, segment in enumerate(plan.segments):
        trajectory = segment.trajectory
        jump = np.abs(trajectory.qs[0] - end).max()
        if jump > TOLERANCE:
            what = f"starts {jump:.4f} rad from the last one's end"
            yield Violation(number, segment.name, what)
        for what in _beyond_limits(trajectory):
            yield Violation(number, segment.name, what)
        end = trajectory.qs[-1]


def _beyond_limits(trajectory: JointTrajectory) -> Iterator[str]:
    """Yield which limits a trajectory leaves, and where it contradicts itself.

    One sample is executed every `SAMPLE_S`, whatever the times say; until the next, the command
    moves on from `qs` at `vs`.
    """
    limits = arm_limits()
    qs, vs = trajectory.qs, trajectory.vs
    moved = np.diff(qs, axis=0) / SAMPLE_S
    changed = np.diff(np.pad(moved, ((1, 1), (0, 0))), axis=0) / SAMPLE_S
    beyond = np.maximum(limits.q_lower - qs, qs - limits.q_upper).max(axis=0)
    joint = int(np.argmax(beyond))
    if beyond[joint] > TOLERANCE:
        yield f"leaves the range of joint {joint + 1} by {beyond[joint]:.4f} rad"
    for rates, most, unit in (
        (vs, limits.v_max, "rad/s"),
        (moved, limits.v_max, "rad/s"),
        (changed, CORNER_FACTOR * limits.a_max, "rad/s^2"),
    ):
        fastest = np.abs(rates).max(axis=0)
        joint = int(np.argmax(fastest / most))
        if fastest[joint] > most[joint] * (1.0 + 1e-3):
            yield f"moves joint {joint + 1} at {fastest[joint]:.2f} {unit}; at most {most[joint]:g}"
    wrong = float(np.sqrt(np.square(moved - (vs[1:] + vs[:-1]) / 2.0).mean()))
    if wrong > VELOCITY_TOLERANCE:
        yield f"has velocities that are {wrong:.3f} rad/s off those at which its angles change"
    if np.abs(vs[[0, -1]]).max() > TOLERANCE:
        yield f"starts or ends at {np.abs(vs[[0, -1]]).max():.3f} rad/s; expected rest"
