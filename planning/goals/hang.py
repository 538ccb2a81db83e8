"""The subgoal `hang`: a handle is brought onto the peg of the hook, and let down by feel."""

import numpy as np
from numpy.typing import ArrayLike

from planning.collision.exemptions import MAX_LOWERING_M, TUBE_HALF_LENGTH_M
from planning.geometry.modes import mode_means
from planning.goals.upright import SUBGOAL as REORIENT
from planning.subgoal import AllowedContact, Placement, PlacementQuery, Subgoal
from split_drake.pose_task import HANDLE
from split_drake.poses import Array, invert_pose, make_pose, rotation_y, transform_points

# Whether an object hangs is watched from the fourth second after its release: the arm rests then,
# if nothing holds it up.
STILL_AFTER_S = 2.9
# Modes of the pose set that placements are made of.
HANDLE_MODES = 6
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


def hook_goals(X_WK: ArrayLike, thetas_rad: ArrayLike) -> Array:
    """Return X_WHgoals (2T, 4, 4) in which the peg passes through the middle of the opening.

    R_KHgoal = Rot_y(-pi/2 + theta) Rot_x(pi)^s and p_KHgoal = 0.  At theta = 0 x_H points up: the
    object hangs below its handle.  First all angles with s = 0, then with s = 1.

    Args:
        X_WK: (4, 4) hook.
        thetas_rad: (T,) turns about the peg.
    """
    angles = np.atleast_1d(np.asarray(thetas_rad, dtype=float))
    X_KHs = np.stack([make_pose(rotation_y(-np.pi / 2.0 + theta)) for theta in angles])
    X_WHs = np.asarray(X_WK, dtype=float) @ X_KHs
    return np.concatenate([X_WHs, X_WHs @ HANDLE.symmetry.X_half_turn])


def hang_placements(query: PlacementQuery) -> list[Placement]:
    """Return placements on the hook, over handles, turns about the peg, and both ways round.

    Handles whose opening, as far as the cloud shows, has no room for the peg are left out.
    """
    layout, target = query.layout, query.target
    y_WK = layout.X_WK[:3, 1]
    entries = np.stack([(layout.hook.tip_distance_m + room) * y_WK for room in BEYOND_TIP_M])
    thetas = HELD_THETAS_RAD if query.in_hand else HANG_THETAS_RAD
    on_peg = frozenset({AllowedContact.HELD_PEG})
    found = []
    for X_WHseen, score in mode_means(query.poses, HANDLE_MODES):
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


def _hangs_below(X_WH: Array, X_WHgoal: Array, p_WCom: Array) -> float:
    """Return a factor in (0, 1]: how nearly the centre of mass comes to lie below the peg."""
    p_HCom = transform_points(invert_pose(X_WH), p_WCom[None])[0]
    p_HCom_W = X_WHgoal[:3, :3] @ p_HCom
    below = -p_HCom_W[2] / max(float(np.linalg.norm(p_HCom_W)), 1e-6)
    angle = np.arccos(np.clip(below, -1.0, 1.0))
    return float(np.exp(-np.square(angle / np.radians(35.0))))


SUBGOAL = Subgoal(
    name="hang",
    task=HANDLE,
    placements=hang_placements,
    goal_noun="hook goals",
    goes_home=False,
    still_after_s=STILL_AFTER_S,
    first=REORIENT,
)
