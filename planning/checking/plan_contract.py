"""Whether a plan does what its problem asks for, whatever it touches on the way.

`planning.checking.trajectory_check` says what a plan collides with; this says whether it begins at
the robot, closes on what was perceived, and brings it to where the subgoal wants it.
"""

import re
from collections.abc import Iterator

import numpy as np

from planning.checking.goal_checks import goal_check
from planning.checking.violation import Violation
from planning.geometry.perceived import PerceivedObject, best_upright
from planning.geometry.waypoints import place_grasp
from planning.problem import SAMPLE_S, Plan, PlanningProblem, Segment, SegmentName
from split_drake.objects_in_view import objects_in_view, owners
from split_drake.pose_set import PoseSet
from split_drake.poses import Array, invert_pose, rotation_error_rad, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PAD_SIZE_M
from split_drake.robot.kinematics import gripper_pose

_PICK = (SegmentName.TRANSIT, SegmentName.APPROACH, SegmentName.CLOSE, SegmentName.LIFT)
_ORDER = re.compile(rf"(?:{';'.join(_PICK)};)?transfer;(?:insert;)+open;retreat;(transit;)?")
_HELD = (SegmentName.LIFT, SegmentName.TRANSFER, SegmentName.INSERT)
# Poses that a plan states are those that its joint angles give, to this precision.
AGREE_M, AGREE_RAD = 0.001, np.radians(0.5)
# What is placed is what was detected: a pose of the set, a mean of several, one moved a little.
DETECTED_M, DETECTED_RAD = 0.02, np.radians(20.0)
# Points of the object lie between the pads, or at most so far beside them.
BESIDE_PADS_M = 0.005


def contract_violations(plan: Plan, problem: PlanningProblem) -> list[Violation]:
    """Return what keeps a plan from solving its problem; empty where nothing does.

    Segments that are not those of `Plan` are all that is reported of a plan that has others.
    """
    malformed = list(_of_order(plan, problem))
    if malformed:
        return [Violation(None, "plan", what) for what in malformed]
    whats = (*_of_poses(plan), *_of_ends(plan, problem))
    found = [Violation(None, "plan", what) for what in whats]
    for number, segment in enumerate(plan.segments):
        found += [Violation(number, segment.name, what) for what in _of_segment(segment)]
    lowering = max(i for i, s in enumerate(plan.segments) if s.name is SegmentName.INSERT)
    if not plan.segments[lowering].stop_on_contact:
        found.append(Violation(lowering, SegmentName.INSERT, "is the last and stops at no contact"))
    return found


def _of_order(plan: Plan, problem: PlanningProblem) -> Iterator[str]:
    """Yield what is wrong with the plan's subgoal and with which segments it has."""
    if plan.subgoal != problem.subgoal:
        yield f"is to {plan.subgoal}, where the problem is to {problem.subgoal}"
    names = [segment.name for segment in plan.segments]
    order = _ORDER.fullmatch("".join(f"{name};" for name in names))
    if not order or (plan.subgoal.goes_home and not order.group(1)):
        yield f"has the segments {', '.join(names)}; see Plan for those expected"
        return
    held = problem.held_width_m is not None
    if held != (names[0] is SegmentName.TRANSFER):
        where = "in the hand" if held else "on the table"
        yield f"begins with {names[0]}, where the object is {where}"


def _of_segment(segment: Segment) -> Iterator[str]:
    """Yield how a segment is not what its name says, or not sampled as it will be executed."""
    qs, times_s = segment.trajectory.qs, segment.trajectory.times_s
    if segment.name in (SegmentName.CLOSE, SegmentName.OPEN) and np.ptp(qs, axis=0).max() > 1e-6:
        yield f"moves the arm by {np.ptp(qs, axis=0).max():.4f} rad; expected rest"
    carries = segment.name in _HELD
    if segment.holding != carries:
        yield f"has holding = {segment.holding}"
    width_m, end_m = segment.held_width_m, segment.opening_end_m
    grips = carries or segment.name is SegmentName.CLOSE
    if grips and not (end_m < width_m and segment.force_n > 0.0):
        yield (
            f"ends with an opening of {end_m:.3f} m and {segment.force_n:g} N around what is "
            f"{width_m:.3f} m wide; expected a squeeze"
        )
    if segment.name is SegmentName.OPEN and end_m <= width_m:
        yield f"opens to {end_m:.3f} m around what is {width_m:.3f} m wide"
    steps_s = np.diff(times_s)
    worst_s = float(steps_s[np.argmax(np.abs(steps_s - SAMPLE_S))])
    if abs(worst_s - SAMPLE_S) > 1e-6:
        yield f"has samples {1e3 * worst_s:g} ms apart; expected {1e3 * SAMPLE_S:g} ms"


def _of_poses(plan: Plan) -> Iterator[str]:
    """Yield which of the plan's poses are not those that its joint angles give."""
    q_taken = _first(plan, SegmentName.CLOSE if plan.pick else SegmentName.TRANSFER)
    q_released = _first(plan, SegmentName.OPEN)
    # The object moves with the hand from the grasp to the release.
    X_WCarried = place_grasp(plan.X_WGplace, plan.X_WGrasp, plan.X_WObject)
    for name, X_WStated, X_WFound in (
        ("X_WGrasp", plan.X_WGrasp, gripper_pose(q_taken)),
        ("X_WGplace", plan.X_WGplace, gripper_pose(q_released)),
        ("X_WGoal", plan.X_WGoal, X_WCarried),
    ):
        distance_m, angle_rad = _apart(X_WStated, X_WFound)
        if distance_m > AGREE_M or angle_rad > AGREE_RAD:
            yield f"states an {name} that is {_named(distance_m, angle_rad)} from where it comes to"


def _of_ends(plan: Plan, problem: PlanningProblem) -> Iterator[str]:
    """Yield whether it begins elsewhere, takes what was not perceived, or ends beside the goal."""
    jump = float(np.abs(plan.segments[0].trajectory.qs[0] - problem.q_start).max())
    if jump > AGREE_RAD:
        yield f"starts {jump:.4f} rad from q_start"
    if plan.pick and not _between_pads(plan.X_WGrasp, problem):
        yield "closes where no point of the object is between the pads"
    if plan.pick and not _of_one_object(plan, problem):
        yield "takes one object, and places a frame of another"
    poses = problem.pose_sets[problem.subgoal.task.name]
    if not _detected(plan.X_WObject, poses):
        yield f"places an X_WObject that no {poses.task} pose of the problem is like"
    if off := goal_check(problem.subgoal.name).off_goal(plan, problem):
        yield f"brings the object to {off}"


def _first(plan: Plan, name: SegmentName) -> Array:
    """Return the joint angles (7,) at which the segment of that name begins."""
    return next(s.trajectory.qs[0] for s in plan.segments if s.name is name)


def _detected(X_WO: Array, poses: PoseSet) -> bool:
    """Return whether the set has a pose that is like X_WO (4, 4), or means the same."""
    distances = np.linalg.norm(poses.X_WPs[:, :3, 3] - X_WO[:3, 3], axis=1)
    angles = poses.task.symmetry.rotation_error_rad(poses.X_WPs[:, :3, :3], X_WO[:3, :3])
    return bool(np.any((distances < DETECTED_M) & (angles < DETECTED_RAD)))


def _of_one_object(plan: Plan, problem: PlanningProblem) -> bool:
    """Return whether grasp and placed frame belong to one object, of those that the cloud shows."""
    objects = objects_in_view(problem.p_WPs)
    if len(objects) < 2:
        return True
    taken, placed = owners(np.stack([plan.X_WGrasp, plan.X_WObject]), objects)
    return bool(taken == placed)


def _between_pads(X_WG: Array, problem: PlanningProblem) -> bool:
    """Return whether the object, completed where its upright pose is known, is between the pads."""
    X_WU = best_upright(problem.pose_sets)
    surface = PerceivedObject.from_cloud(problem.p_WPs, X_WU, problem.layout.table_z_m).p_WSurface
    half_x_m, half_z_m = (0.5 * size_m + BESIDE_PADS_M for size_m in PAD_SIZE_M)
    p_GPs = np.abs(transform_points(invert_pose(X_WG), surface))
    return bool(np.any(np.all(p_GPs < (half_x_m, 0.5 * MAX_OPENING_M, half_z_m), axis=1)))


def _apart(X_WA: Array, X_WB: Array) -> tuple[float, float]:
    distance_m = float(np.linalg.norm(X_WA[:3, 3] - X_WB[:3, 3]))
    return distance_m, float(rotation_error_rad(X_WA[:3, :3], X_WB[:3, :3]))


def _named(distance_m: float, angle_rad: float) -> str:
    return f"{1e3 * distance_m:.1f} mm and {np.degrees(angle_rad):.1f} deg"
