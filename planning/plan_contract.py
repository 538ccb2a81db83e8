"""Whether a plan does what its problem asks for, whatever it touches on the way.

`planning.trajectory_check` says what a plan collides with; this says whether it begins at the
robot, takes what was perceived, and brings it to where the subgoal wants it.
"""

import re
from collections.abc import Iterator

import numpy as np

from planning.exemptions import MAX_LOWERING_M, TABLE_LOWERING_M
from planning.kinematics import gripper_pose
from planning.problem import Plan, PlanningProblem, Segment, SegmentName, Subgoal
from planning.timing import SAMPLE_S
from planning.violation import Violation
from planning.waypoints import HANDLE_FLIP, place_grasp
from split_drake.layout import Layout
from split_drake.pose_set import PoseSet, PoseTask
from split_drake.poses import Array, invert_pose, rotation_error_rad

PICK = (SegmentName.TRANSIT, SegmentName.APPROACH, SegmentName.CLOSE, SegmentName.LIFT)
_ORDER = re.compile(rf"(?:{';'.join(PICK)};)?transfer;(?:insert;)+open;retreat;(?:transit;)?")
_HELD = (SegmentName.LIFT, SegmentName.TRANSFER, SegmentName.INSERT)
# Poses that a plan states are those that its joint angles give, to this precision.
AGREE_M, AGREE_RAD = 0.001, np.radians(0.5)
# What is placed is what was detected: a pose of the set, a mean of several, one moved a little.
DETECTED_M, DETECTED_RAD = 0.02, np.radians(20.0)
# A grasp may be where no camera sees the object, but not further from what they see.
NEAR_M = 0.10
# How far from the peg's axis, and from the table, the frame of a placed object may end.
ON_PEG_M, ON_PEG_RAD = MAX_LOWERING_M + 0.01, np.radians(10.0)
ON_TABLE_M, ON_TABLE_RAD = TABLE_LOWERING_M + 0.03, np.radians(5.0)


def contract_violations(plan: Plan, problem: PlanningProblem) -> list[Violation]:
    """Return what keeps a plan from solving its problem; empty where nothing does.

    Segments that are not those of `Plan` are all that is reported of a plan that has others.
    """
    malformed = list(_of_segments(plan, problem))
    if malformed:
        return [Violation(None, "plan", what) for what in malformed]
    found = [Violation(None, "plan", what) for what in (*_of_poses(plan), *_of_ends(plan, problem))]
    samples = ((i, s, _of_samples(s)) for i, s in enumerate(plan.segments))
    return found + [Violation(i, s.name, what) for i, s, what in samples if what]


def _of_segments(plan: Plan, problem: PlanningProblem) -> Iterator[str]:
    """Yield what is wrong with the plan's subgoal and with which segments it has."""
    if plan.subgoal is not problem.subgoal:
        yield f"is to {plan.subgoal}, where the problem is to {problem.subgoal}"
    names = [segment.name for segment in plan.segments]
    if not _ORDER.fullmatch("".join(f"{name};" for name in names)):
        yield f"has the segments {', '.join(names)}; see Plan for those expected"
        return
    held = problem.held_width_m is not None
    if held != (names[0] is SegmentName.TRANSFER):
        where = "in the hand" if held else "on the table"
        yield f"begins with {names[0]}, where the object is {where}"
    wrong = [s.name for s in plan.segments if s.holding != (s.name in _HELD)]
    if wrong:
        yield f"holds the object from {_HELD[0]} to {_HELD[-1]}, but not so in {', '.join(wrong)}"


def _of_poses(plan: Plan) -> Iterator[str]:
    """Yield which of the plan's poses are not those that its joint angles give."""
    first = plan.place[0] if not plan.pick else _last(plan, SegmentName.CLOSE)
    given = (
        ("X_WGrasp", plan.X_WGrasp, gripper_pose(first.trajectory.qs[0])),
        (
            "X_WGplace",
            plan.X_WGplace,
            gripper_pose(_last(plan, SegmentName.OPEN).trajectory.qs[0]),
        ),
        (
            "X_WGoal",
            plan.X_WGoal,
            # What moves with the hand from the grasp to the release.
            place_grasp(plan.X_WGplace, plan.X_WGrasp, plan.X_WObject),
        ),
    )
    for name, stated, is_at in given:
        distance_m, angle_rad = _apart(stated, is_at)
        if distance_m > AGREE_M or angle_rad > AGREE_RAD:
            yield f"states an {name} that is {_named(distance_m, angle_rad)} from where it comes to"


def _of_ends(plan: Plan, problem: PlanningProblem) -> Iterator[str]:
    """Yield whether it begins elsewhere, takes what was not perceived, or ends beside the goal."""
    jump = float(np.abs(plan.segments[0].trajectory.qs[0] - problem.q_start).max())
    if jump > AGREE_RAD:
        yield f"starts {jump:.4f} rad from q_start"
    near_m = float(np.linalg.norm(problem.p_WPs - plan.X_WGrasp[:3, 3], axis=1).min())
    if near_m > NEAR_M:
        yield f"closes {near_m:.3f} m from the nearest point of the object"
    hangs = problem.subgoal is Subgoal.HANG
    poses = problem.pose_sets[PoseTask.HANDLE if hangs else PoseTask.UPRIGHT]
    if not _detected(plan.X_WObject, poses):
        yield f"places an X_WObject that no {poses.task} pose of the problem is like"
    off = _off_peg(plan.X_WGoal, problem.layout) if hangs else _off_table(plan.X_WGoal)
    if off:
        yield f"brings the object to {off}"


def _of_samples(segment: Segment) -> str:
    """Return that a segment is not sampled as it will be executed, or an empty string."""
    steps_s = np.diff(segment.trajectory.times_s)
    worst = float(steps_s[np.argmax(np.abs(steps_s - SAMPLE_S))])
    if abs(worst - SAMPLE_S) <= 1e-6:
        return ""
    return f"has samples {1e3 * worst:g} ms apart; expected {1e3 * SAMPLE_S:g} ms"


def _last(plan: Plan, name: SegmentName) -> Segment:
    return next(segment for segment in reversed(plan.segments) if segment.name is name)


def _detected(X_WO: Array, poses: PoseSet) -> bool:
    """Return whether the set has a pose like X_WO (4, 4); both poses of a handle are the same."""
    alike = [poses.X_WPs, *([poses.X_WPs @ HANDLE_FLIP] * (poses.task is PoseTask.HANDLE))]
    X_WPs = np.concatenate(alike)
    distances = np.linalg.norm(X_WPs[:, :3, 3] - X_WO[:3, 3], axis=1)
    angles = rotation_error_rad(X_WPs[:, :3, :3], X_WO[:3, :3])
    return bool(np.any((distances < DETECTED_M) & (angles < DETECTED_RAD)))


def _off_peg(X_WH: Array, layout: Layout) -> str:
    """Return where a handle (4, 4) ends that is not around the peg, or an empty string."""
    X_KH = invert_pose(layout.X_WK) @ X_WH
    aside_m = float(np.hypot(X_KH[0, 3], X_KH[2, 3]))
    angle_rad = float(np.arccos(min(1.0, abs(X_KH[1, 1]))))
    beside = abs(X_KH[1, 3]) > layout.hook.tip_distance_m
    if aside_m <= ON_PEG_M and angle_rad <= ON_PEG_RAD and not beside:
        return ""
    along = f"{1e3 * X_KH[1, 3]:.0f} mm along the peg"
    return f"{along}, {_named(aside_m, angle_rad)} off its axis"


def _off_table(X_WU: Array) -> str:
    """Return how an object (4, 4) ends that does not stand on the table, or an empty string."""
    tilt_rad = float(np.arccos(np.clip(X_WU[2, 2], -1.0, 1.0)))
    if tilt_rad <= ON_TABLE_RAD and abs(X_WU[2, 3]) <= ON_TABLE_M:
        return ""
    return f"{1e3 * X_WU[2, 3]:.0f} mm above the table, tilted by {np.degrees(tilt_rad):.0f} deg"


def _apart(X_WA: Array, X_WB: Array) -> tuple[float, float]:
    distance_m = float(np.linalg.norm(X_WA[:3, 3] - X_WB[:3, 3]))
    return distance_m, float(rotation_error_rad(X_WA[:3, :3], X_WB[:3, :3]))


def _named(distance_m: float, angle_rad: float) -> str:
    return f"{1e3 * distance_m:.1f} mm and {np.degrees(angle_rad):.1f} deg"
