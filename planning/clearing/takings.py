"""Ways to take something from a cluttered table: approach, grasp and lift, as joint angles."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planning.clearing.taken_points import taken_points
from planning.collision.exemptions import TABLE_LIFT_M
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import DETAIL_VOXEL_M, OBSTACLE_VOXEL_M, voxel_centroids
from planning.geometry.waypoints import (
    APPROACH_M,
    LINE_STEP_M,
    backed_off,
    shifted,
    straight_line,
)
from planning.motion.ik import follow
from planning.pick_place.fingers import fit_fingers
from planning.subgoal import AllowedContact
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M

CONFIGURATIONS = 4
APPROACHES_M = (APPROACH_M, 0.05)
LIFTS_M = (0.25, 0.20, 0.15)


@dataclass(frozen=True)
class Taking:
    """How something is taken.

    Attributes:
        approach_qs, lift_qs: (N, 7) joint angles, rad.
        before, grasping: the situations on the way to the pregrasp, and from there on.
        lifting, carrying: those of the lift, and of the way to the bin.
        emptied: that of the open hand afterwards.
    """

    approach_qs: Array
    lift_qs: Array
    before: Situation
    grasping: Situation
    lifting: Situation
    carrying: Situation
    emptied: Situation


class TakingSearch:
    """Finds ways to take something, and counts what grasps are rejected by.

    The open fingers may touch anything in front of the pregrasp: a grasp in clutter comes near to
    what stands beside it, and the hand stops where it feels that.  Palm and arm keep clear of all.
    """

    def __init__(self, world: CollisionWorld, p_WPs: Array) -> None:
        self._world = world
        self._details = voxel_centroids(p_WPs, DETAIL_VOXEL_M)
        obstacles = voxel_centroids(self._details, OBSTACLE_VOXEL_M)
        self._before = Situation(MAX_OPENING_M, p_WStanding=obstacles)
        fingers = frozenset({AllowedContact.FINGERS_TARGET})
        self._grasping = Situation(MAX_OPENING_M, p_WStanding=obstacles, allowed=fingers)
        self.rejected: Counter[str] = Counter()

    def find(self, X_WG: Array, qs: Array) -> Iterator[Taking]:
        """Yield ways to take what is at the grasp X_WG (4, 4), by its IK solutions (N, 7)."""
        if not len(qs):
            self.rejected["IK"] += 1
            return
        taken = taken_points(X_WG, self._details)
        if not taken.any():
            self.rejected["nothing between the pads"] += 1
            return
        for q in qs[:CONFIGURATIONS]:
            taking = self._at(q, X_WG, taken)
            if isinstance(taking, Taking):
                yield taking
            else:
                self.rejected[taking] += 1

    def _at(self, q: Array, X_WG: Array, taken: NDArray[np.bool_]) -> Taking | str:
        """Return how the points marked `taken` are taken at `q` (7,), or what is in the way."""
        if not self._world.free(q[None], self._grasping)[0]:
            return "collision at the grasp"
        approach = self._approach(q, X_WG)
        if approach is None:
            return "approach"
        lifting, carrying, emptied = self._after(X_WG, taken)
        lift = self._lift(q, X_WG, lifting, carrying)
        if lift is None:
            return "lift"
        return Taking(approach, lift, self._before, self._grasping, lifting, carrying, emptied)

    def _after(
        self, X_WG: Array, taken: NDArray[np.bool_]
    ) -> tuple[Situation, Situation, Situation]:
        """Return the situations of the lift, of the way to the bin, and of that back."""
        p_GHeld = transform_points(invert_pose(X_WG), self._details[taken])
        width_m = fit_fingers(X_WG, self._details[taken]).held_width_m
        others = None
        if not taken.all():
            others = voxel_centroids(self._details[~taken], OBSTACLE_VOXEL_M)
        lifting = Situation(
            width_m,
            p_GHeld=p_GHeld,
            table_below_m=float(X_WG[2, 3]) + TABLE_LIFT_M,
            allowed=frozenset({AllowedContact.HELD_TABLE}),
        )
        carrying = Situation(width_m, p_WStanding=others, p_GHeld=p_GHeld)
        return lifting, carrying, Situation(MAX_OPENING_M, p_WStanding=others)

    def _approach(self, q: Array, X_WG: Array) -> Array | None:
        """Return (A, 7) from the furthest pregrasp that works to the grasp at `q`."""
        for distance in APPROACHES_M:
            back = follow(q, straight_line(X_WG, backed_off(X_WG, distance), LINE_STEP_M))
            if back is None or not self._world.free(back[-1:], self._before)[0]:
                continue
            path = np.concatenate([back[::-1], q[None]])
            if self._world.path_free(path, self._grasping):
                return path
        return None

    def _lift(self, q: Array, X_WG: Array, lifting: Situation, carrying: Situation) -> Array | None:
        """Return (L, 7) straight up from `q` to where what is held is clear of what stands."""
        for height in LIFTS_M:
            up = follow(q, straight_line(X_WG, shifted(X_WG, (0.0, 0.0, height)), LINE_STEP_M))
            if up is None or not self._world.free(up[-1:], carrying)[0]:
                continue
            path = np.concatenate([q[None], up])
            if self._world.path_free(path, lifting):
                return path
        return None
