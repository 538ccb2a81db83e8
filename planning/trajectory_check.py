"""The independent check of plans: every segment again, at a finer step, by Drake's own geometry.

Shares with the planner only the definition of the exemptions.  Forward kinematics, distances and
collisions come from a MultibodyPlant's QueryObject; the planner has its own in numpy.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import GeometryId, QueryObject
from pydrake.planning import RobotDiagramBuilder

from planning.exemptions import peg_tube
from planning.problem import AllowedContact, Plan, Segment
from split_drake.fixtures import HOOK_BODY, TABLE_BODY, add_hook, add_table
from split_drake.layout import Layout
from split_drake.panda import (
    FINGER_BODIES,
    GRIPPER_FRAME,
    HAND_BODIES,
    add_panda,
    arm_limits,
    panda_positions,
)
from split_drake.poses import Array, invert_pose, transform_points

STEP_RAD = 0.005
# Nearer than this, a point of the object counts as touching; the planner keeps further away.
TOUCH_M = 0.003
# Segments join, and limits hold, to this precision (rad, rad/s).
TOLERANCE = 1e-6
# FINGERS_TARGET is declared for this stretch at most before the grasp and after the release.
FINGER_STRETCH_M = 0.08 + 1e-4
# What is next to the held object by construction.
_HOLDERS = (*HAND_BODIES, "panda_link7")


@dataclass(frozen=True)
class Violation:
    """A contact that no segment declares, or a motion that the arm cannot make.

    Attributes:
        segment: number of the segment, from 0.
        name: of the segment.
        what: is wrong, with the values.
    """

    segment: int
    name: str
    what: str


class TrajectoryChecker:
    """Checks plans for a layout.

    Args:
        layout: of the static station.
    """

    def __init__(self, layout: Layout) -> None:
        builder = RobotDiagramBuilder(time_step=0.001)
        plant = builder.plant()
        self._panda = add_panda(plant)
        add_table(plant, layout)
        add_hook(plant, layout)
        self._diagram = builder.Build()
        self._plant = plant
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)
        self._gripper = plant.GetFrameByName(GRIPPER_FRAME)
        self._inspector = self._diagram.scene_graph().model_inspector()
        hook = plant.GetBodyByName(HOOK_BODY)
        self._peg = plant.GetCollisionGeometriesForBody(hook)[0]

    def violations(self, plan: Plan, p_WPs: Array) -> list[Violation]:
        """Return what is wrong with the plan; empty where nothing is.

        Args:
            plan: to be checked.
            p_WPs: (N, 3) points on the object's surface before the pick.
        """
        exempt = peg_tube(p_WPs, plan.X_WObject, plan.X_WGoal)
        X_WGrasp, X_WGRelease = self._gripper_ends(plan)
        p_GPs = transform_points(invert_pose(X_WGrasp), p_WPs)
        found = list(_kinematic_violations(plan))
        picked = False
        for number, segment in enumerate(plan.segments):
            picked |= segment.holding
            X_WGEnd = X_WGRelease if picked else X_WGrasp
            standing = transform_points(X_WGEnd, p_GPs)
            points = p_GPs if segment.holding else standing
            what = self._first_contact(segment, points, exempt)
            what = what or self._first_far_exemption(segment, X_WGEnd[:3, 3])
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

    def _first_contact(self, segment: Segment, points: Array, exempt: NDArray[np.bool_]) -> str:
        """Return the first undeclared contact of a segment, or an empty string.

        `points` (N, 3) are in G where the object is held, else in W.
        """
        openings = {max(m, 0.0) for m in (segment.opening_start_m, segment.opening_end_m)}
        for q, opening_m in product(fine_steps(segment.trajectory.qs), openings):
            p_WPs = transform_points(self._pose_at(q), points) if segment.holding else points
            query = self._query(q, opening_m)
            for pair in query.ComputePointPairPenetration():
                bodies = " and ".join(self._body(i) for i in (pair.id_A, pair.id_B))
                return f"{bodies} overlap by {1e3 * pair.depth:.1f} mm at q = {np.round(q, 3)}"
            for point, spared in zip(p_WPs, exempt, strict=True):
                for hit in query.ComputeSignedDistanceToPoint(point, TOUCH_M):
                    if not self._declared(hit.id_G, segment, bool(spared)):
                        return (
                            f"the object is {1e3 * hit.distance:.1f} mm from "
                            f"{self._body(hit.id_G)} at q = {np.round(q, 3)}"
                        )
        return ""

    def _declared(self, geometry: GeometryId, segment: Segment, spared: bool) -> bool:
        """Return whether the object may touch a geometry, `spared` being within the peg's tube."""
        body, contacts = self._body(geometry), segment.allowed_contacts
        if not segment.holding:
            fingers = body in FINGER_BODIES and AllowedContact.FINGERS_TARGET in contacts
            return fingers or body in (TABLE_BODY, HOOK_BODY)
        if body == TABLE_BODY:
            return AllowedContact.HELD_TABLE in contacts
        if geometry == self._peg:
            return AllowedContact.HELD_PEG in contacts and spared
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
    """Yield where segments do not join or leave the limits of the joints."""
    limits = arm_limits()
    end = plan.segments[0].trajectory.qs[0]
    for number, segment in enumerate(plan.segments):
        qs, vs = segment.trajectory.qs, segment.trajectory.vs
        jump = np.abs(qs[0] - end).max()
        if jump > TOLERANCE:
            yield Violation(number, segment.name, f"starts {jump:.4f} rad from the last one's end")
        if np.any(qs < limits.q_lower - TOLERANCE) or np.any(qs > limits.q_upper + TOLERANCE):
            yield Violation(number, segment.name, "leaves the joints' range")
        if np.any(np.abs(vs) > limits.v_max + TOLERANCE):
            yield Violation(number, segment.name, f"reaches {np.abs(vs).max():.2f} rad/s")
        if np.abs(vs[[0, -1]]).max() > TOLERANCE:
            yield Violation(number, segment.name, "does not start and end at rest")
        end = qs[-1]
