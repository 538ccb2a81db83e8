"""Where a held object can go: on the hook, or upright on the table."""

from dataclasses import dataclass

import numpy as np

from planning.candidates import mode_means
from planning.exemptions import MAX_LOWERING_M, TUBE_HALF_LENGTH_M
from planning.perceived import PerceivedObject
from planning.problem import AllowedContact, PlanningProblem, Subgoal
from planning.waypoints import hook_goals, upright_goals
from split_drake.pose_set import PoseTask
from split_drake.poses import Array, invert_pose, transform_points

# Modes of the pose set that placements are made of.
HANDLE_MODES = 6
UPRIGHT_MODES = 3

HANG_THETAS_RAD = np.radians(np.arange(-60.0, 61.0, 15.0))
# Beyond the peg's tip there is room for a handle, and for the body beside it.
BEYOND_TIP_M = (0.055, 0.04)
# Where the cloud leaves less room than this around the handle's axis, the peg won't fit.
MIN_AXIS_CLEARANCE_M = 0.003
GOOD_AXIS_CLEARANCE_M = 0.008

PLACE_OFFSETS_M = (0.0, -0.06, 0.06)
PLACE_YAWS_RAD = np.radians(np.arange(0.0, 360.0, 30.0))
PREPLACE_M = 0.10
# An upright object is let down from just above the table until it touches it, or to just below.
UPRIGHT_FROM_M, UPRIGHT_TO_M = 0.015, -0.006


@dataclass(frozen=True)
class Placement:
    """One way to place an object, whatever it is held by.

    Attributes:
        X_WO: (4, 4) the object's frame (H or U) before the pick.
        X_WOgoal: (4, 4) the same frame where it is released.
        score: in [0, 1].
        entries_W: (E, 3) offsets from the goal at which the insertion may start, best first.
        lower_from_m, lower_to_m: heights above the goal between which it is let down, stopping
            where it touches.
        contacts: that the insertion declares.
    """

    X_WO: Array
    X_WOgoal: Array
    score: float
    entries_W: Array
    lower_from_m: float
    lower_to_m: float
    contacts: frozenset[AllowedContact]


def placements(problem: PlanningProblem, target: PerceivedObject) -> list[Placement]:
    """Return all placements that serve the problem's subgoal; none where nothing was detected."""
    if problem.subgoal is Subgoal.HANG:
        return hang_placements(problem, target)
    return upright_placements(problem)


def hang_placements(problem: PlanningProblem, target: PerceivedObject) -> list[Placement]:
    """Return placements on the hook, over handles, turns about the peg, and both ways round."""
    layout = problem.layout
    y_WK = layout.X_WK[:3, 1]
    entries = np.stack([(layout.hook.tip_distance_m + room) * y_WK for room in BEYOND_TIP_M])
    found = []
    for X_WH, score in mode_means(problem.pose_sets[PoseTask.HANDLE], HANDLE_MODES):
        clearance = axis_clearance(X_WH, target.p_WDetails)
        if clearance < MIN_AXIS_CLEARANCE_M:
            continue
        fits = min(1.0, clearance / GOOD_AXIS_CLEARANCE_M)
        for X_WHgoal in hook_goals(layout.X_WK, HANG_THETAS_RAD):
            hangs = _hangs_below(X_WH, X_WHgoal, target.p_WCom)
            found.append(
                Placement(
                    X_WO=X_WH,
                    X_WOgoal=X_WHgoal,
                    score=score * fits * hangs,
                    entries_W=entries,
                    lower_from_m=0.0,
                    lower_to_m=-MAX_LOWERING_M,
                    contacts=frozenset({AllowedContact.HELD_PEG}),
                )
            )
    return found


def upright_placements(problem: PlanningProblem) -> list[Placement]:
    """Return upright placements around the workspace's centre, where the cameras see them."""
    center = np.array(problem.layout.workspace.p_WCenter)
    places = center + np.array([(x, y, 0.0) for x in PLACE_OFFSETS_M for y in PLACE_OFFSETS_M])
    found = []
    for X_WU, score in mode_means(problem.pose_sets[PoseTask.UPRIGHT], UPRIGHT_MODES):
        for X_WUgoal in upright_goals(places, PLACE_YAWS_RAD):
            central = np.exp(-np.square(np.linalg.norm(X_WUgoal[:3, 3] - center) / 0.15))
            found.append(
                Placement(
                    X_WO=X_WU,
                    X_WOgoal=X_WUgoal,
                    score=score * float(central),
                    entries_W=np.array([[0.0, 0.0, PREPLACE_M]]),
                    lower_from_m=UPRIGHT_FROM_M,
                    lower_to_m=UPRIGHT_TO_M,
                    contacts=frozenset({AllowedContact.HELD_TABLE}),
                )
            )
    return found


def axis_clearance(X_WH: Array, p_WPs: Array) -> float:
    """Return the least distance of points (N, 3) in the opening to the handle's axis y_H."""
    p_HPs = transform_points(invert_pose(X_WH), p_WPs)
    within = np.abs(p_HPs[:, 1]) < TUBE_HALF_LENGTH_M
    return float(np.min(np.hypot(p_HPs[within, 0], p_HPs[within, 2]), initial=np.inf))


def _hangs_below(X_WH: Array, X_WHgoal: Array, p_WCom: Array) -> float:
    """Return a factor in (0, 1]: how nearly the centre of mass comes to lie below the peg."""
    p_HCom = transform_points(invert_pose(X_WH), p_WCom[None])[0]
    p_KCom = X_WHgoal[:3, :3] @ p_HCom
    angle = np.arccos(np.clip(-p_KCom[2] / max(float(np.linalg.norm(p_KCom)), 1e-6), -1.0, 1.0))
    return float(np.exp(-np.square(angle / np.radians(35.0))))
