"""Where a held object can go: on the hook, or upright on the table."""

from dataclasses import dataclass

import numpy as np

from planning.candidates import mode_means
from planning.exemptions import (
    MAX_LOWERING_M,
    TABLE_ERROR_M,
    TABLE_LOWERING_M,
    TUBE_HALF_LENGTH_M,
)
from planning.perceived import PerceivedObject
from planning.problem import AllowedContact, PlanningProblem, Subgoal
from planning.waypoints import HANDLE_FLIP, hook_goals, shifted, upright_goals
from split_drake.pose_set import PoseTask
from split_drake.poses import Array, invert_pose, make_pose, transform_points

# Modes of the pose set that placements are made of.
HANDLE_MODES = 6
UPRIGHT_MODES = 3

# Turns about the peg; more of them for an object that is in the hand already, since there are fewer
# pairs to try.
HANG_THETAS_RAD = np.radians(np.arange(-60.0, 61.0, 15.0))
HELD_THETAS_RAD = np.radians(np.arange(-60.0, 61.0, 5.0))
# Beyond the peg's tip there is room for a handle, and for the body beside it.
BEYOND_TIP_M = (0.055, 0.04)
# Room around the handle's axis, as far as the cloud shows, beyond which more is no better.
GOOD_AXIS_CLEARANCE_M = 0.009
# Detected axes are some millimetres off: with less room they are moved by up to this much.
MAX_AXIS_SHIFT_M = 0.008
AXIS_SHIFT_STEP_M = 0.001

PLACE_OFFSETS_M = (0.0, -0.06, 0.06)
PLACE_YAWS_RAD = np.radians(np.arange(0.0, 360.0, 30.0))
PREPLACE_M = 0.10
# An upright object is let down from just above the table until it touches it, or to just below.
UPRIGHT_FROM_M, UPRIGHT_TO_M = 0.015, -TABLE_LOWERING_M


@dataclass(frozen=True)
class Placement:
    """One way to place an object, whatever it is held by.

    Attributes:
        X_WO: (4, 4) the object's frame (H or U) before the pick.
        X_WOgoal: (4, 4) the same frame where it is released.
        score: in [0, 1].
        p_OEntries_W: (E, 3) offsets from the goal at which the insertion may start, best first.
        lower_from_m, lower_to_m: heights above the goal between which it is let down, stopping
            where it touches.
        insert_contacts: that the insertion declares.
        lower_contacts: that the lowering declares.
    """

    X_WO: Array
    X_WOgoal: Array
    score: float
    p_OEntries_W: Array
    lower_from_m: float
    lower_to_m: float
    insert_contacts: frozenset[AllowedContact]
    lower_contacts: frozenset[AllowedContact]


def placements(problem: PlanningProblem, target: PerceivedObject) -> list[Placement]:
    """Return all placements that serve the problem's subgoal; none where nothing was detected."""
    if problem.subgoal is Subgoal.HANG:
        return hang_placements(problem, target)
    return upright_placements(problem, target)


def hang_placements(problem: PlanningProblem, target: PerceivedObject) -> list[Placement]:
    """Return placements on the hook, over handles, turns about the peg, and both ways round.

    Handles whose opening, as far as the cloud shows, has no room for the peg are left out.
    """
    layout = problem.layout
    y_WK = layout.X_WK[:3, 1]
    entries = np.stack([(layout.hook.tip_distance_m + room) * y_WK for room in BEYOND_TIP_M])
    handles = problem.pose_sets[PoseTask.HANDLE]
    thetas = HANG_THETAS_RAD if problem.held_width_m is None else HELD_THETAS_RAD
    on_peg = frozenset({AllowedContact.HELD_PEG})
    found = []
    for X_WHseen, score in mode_means(handles, HANDLE_MODES, HANDLE_FLIP):
        X_WH, clearance = freest_axis(X_WHseen, target.p_WDetails)
        if clearance < layout.hook.peg_radius_m:
            continue
        fits = min(1.0, clearance / GOOD_AXIS_CLEARANCE_M)
        for X_WHgoal in hook_goals(layout.X_WK, thetas):
            hangs = _hangs_below(X_WH, X_WHgoal, target.p_WCom)
            found.append(
                Placement(
                    X_WO=X_WH,
                    X_WOgoal=X_WHgoal,
                    score=score * fits * hangs,
                    p_OEntries_W=entries,
                    lower_from_m=0.0,
                    lower_to_m=-MAX_LOWERING_M,
                    insert_contacts=on_peg,
                    lower_contacts=on_peg,
                )
            )
    return found


def upright_placements(problem: PlanningProblem, target: PerceivedObject) -> list[Placement]:
    """Return upright placements around the workspace's centre, where the cameras see them.

    Where a detected base is too high, the object reaches below it, and is placed higher.
    """
    center = np.array(problem.layout.workspace.p_WCenter)
    places = center + np.array([(x, y, 0.0) for x in PLACE_OFFSETS_M for y in PLACE_OFFSETS_M])
    found = []
    for X_WU, score in mode_means(problem.pose_sets[PoseTask.UPRIGHT], UPRIGHT_MODES):
        raised = (0.0, 0.0, max(0.0, _depth_below(X_WU, target.p_WObstacles) - TABLE_ERROR_M))
        for X_WUgoal in shifted(upright_goals(places, PLACE_YAWS_RAD), raised):
            central = np.exp(-np.square(np.linalg.norm(X_WUgoal[:2, 3] - center[:2]) / 0.15))
            found.append(
                Placement(
                    X_WO=X_WU,
                    X_WOgoal=X_WUgoal,
                    score=score * float(central),
                    p_OEntries_W=np.array([[0.0, 0.0, PREPLACE_M]]),
                    lower_from_m=UPRIGHT_FROM_M,
                    lower_to_m=UPRIGHT_TO_M,
                    insert_contacts=frozenset(),
                    lower_contacts=frozenset({AllowedContact.HELD_TABLE}),
                )
            )
    return found


def freest_axis(X_WH: Array, p_WPs: Array) -> tuple[Array, float]:
    """Return the handle (4, 4) moved within its opening to where the peg has room, and that room.

    The room is the least distance of points (N, 3) in the opening to the axis y_H.  Of the places
    within `MAX_AXIS_SHIFT_M` the freest is taken; of those with room enough, the nearest.
    """
    p_HPs = transform_points(invert_pose(X_WH), p_WPs)
    section = p_HPs[np.abs(p_HPs[:, 1]) < TUBE_HALF_LENGTH_M][:, [0, 2]]
    steps = np.arange(-MAX_AXIS_SHIFT_M, MAX_AXIS_SHIFT_M + 1e-9, AXIS_SHIFT_STEP_M)
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    lengths = np.linalg.norm(shifts, axis=1)
    gaps = np.linalg.norm(section - shifts[:, None], axis=-1).min(axis=1, initial=np.inf)
    useful = np.where(lengths > MAX_AXIS_SHIFT_M + 1e-9, -np.inf, gaps)
    best = np.lexsort([lengths, -np.minimum(useful, GOOD_AXIS_CLEARANCE_M)])[0]
    x, z = shifts[best]
    return X_WH @ make_pose(p=(x, 0.0, z)), float(gaps[best])


def _depth_below(X_WU: Array, p_WPs: Array) -> float:
    """Return how far points (N, 3) reach below the base, against z_U."""
    return float(-transform_points(invert_pose(X_WU), p_WPs)[:, 2].min())


def _hangs_below(X_WH: Array, X_WHgoal: Array, p_WCom: Array) -> float:
    """Return a factor in (0, 1]: how nearly the centre of mass comes to lie below the peg."""
    p_HCom = transform_points(invert_pose(X_WH), p_WCom[None])[0]
    p_HCom_W = X_WHgoal[:3, :3] @ p_HCom
    below = -p_HCom_W[2] / max(float(np.linalg.norm(p_HCom_W)), 1e-6)
    angle = np.arccos(np.clip(below, -1.0, 1.0))
    return float(np.exp(-np.square(angle / np.radians(35.0))))
