"""The subgoal `reorient`: an object is stood upright on the table."""

import numpy as np
from numpy.typing import ArrayLike

from planning.collision.exemptions import TABLE_ERROR_M, TABLE_LOWERING_M
from planning.geometry.modes import mode_means, modes_of
from planning.geometry.waypoints import shifted
from planning.subgoal import AllowedContact, Placement, PlacementQuery, Subgoal
from split_drake.pose_set import PoseSet
from split_drake.pose_task import UPRIGHT
from split_drake.poses import Array, invert_pose, make_pose, rotation_z, transform_points

UPRIGHT_MODES = 3
PLACE_OFFSETS_M = (0.0, -0.06, 0.06)
PLACE_YAWS_RAD = np.radians(np.arange(0.0, 360.0, 30.0))
PREPLACE_M = 0.10
# An upright object is let down from just above the table until it touches it, or to just below.
UPRIGHT_FROM_M, UPRIGHT_TO_M = 0.015, -TABLE_LOWERING_M
# An object that was stood upright is taken to stand where it is seen tilted by no more than this:
# some mugs lean on their handles for good.
STANDING_TILT_RAD = np.radians(15.0)


def upright_goals(p_WUs: ArrayLike, yaws_rad: ArrayLike) -> Array:
    """Return X_WUgoals (P * Y, 4, 4): objects upright at places (P, 3), turned by yaws (Y,)."""
    rotations = np.stack([rotation_z(yaw) for yaw in np.atleast_1d(yaws_rad)])
    places = np.asarray(p_WUs, dtype=float)
    return make_pose(rotations[None], places[:, None]).reshape(-1, 4, 4)


def upright_placements(query: PlacementQuery) -> list[Placement]:
    """Return upright placements around the workspace's centre, where the cameras see them.

    Where a detected base is too high, the object reaches below it, and is placed higher.
    """
    center = np.array(query.layout.workspace.p_WCenter)
    places = center + np.array([(x, y, 0.0) for x in PLACE_OFFSETS_M for y in PLACE_OFFSETS_M])
    found = []
    for X_WU, score in mode_means(query.poses, UPRIGHT_MODES):
        raised = (0.0, 0.0, max(0.0, _depth_below(X_WU, query.target.p_WObstacles) - TABLE_ERROR_M))
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


def _depth_below(X_WU: Array, p_WPs: Array) -> float:
    """Return how far points (N, 3) reach below the base, against z_U."""
    return float(-transform_points(invert_pose(X_WU), p_WPs)[:, 2].min())


def stands(uprights: PoseSet) -> bool:
    """Return whether the best upright pose is hardly tilted; also where there is none to tell."""
    best = [mode.X_WP for mode in modes_of(uprights)[:1]]
    return all(X_WU[2, 2] >= np.cos(STANDING_TILT_RAD) for X_WU in best)


SUBGOAL = Subgoal(
    name="reorient",
    task=UPRIGHT,
    placements=upright_placements,
    goal_noun="upright goals",
    seems_reached=stands,
)
