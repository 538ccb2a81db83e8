"""Places: for a pick and a placement, the configurations that insert, lower and let go."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from planning.collision.exemptions import MAX_LOWERING_M, peg_tube
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject
from planning.geometry.waypoints import (
    APPROACH_M,
    LINE_STEP_M,
    backed_off,
    place_grasp,
    polyline,
    shifted,
    straight_line,
)
from planning.motion.ik import follow
from planning.pick_place.pick import Pick
from planning.subgoal import AllowedContact, Placement
from split_drake.poses import Array, transform_points


@dataclass(frozen=True)
class Place:
    """A feasible way to put the held object down.

    Attributes:
        placement: what it serves.
        X_WG: (4, 4) gripper where it lets go, lowered all the way.
        insert_qs: (I, 7) from the entry to the height where lowering starts.
        lower_qs: (L, 7) down to the lowest height.
        retreat_qs: (R, 7) back along the approach direction.
        p_WReleased: (N, 3) the object's points after its release.
        inserting: the situation during the insertion.
        lowering: the situation while lowered by feel.
    """

    placement: Placement
    X_WG: Array
    insert_qs: Array
    lower_qs: Array
    retreat_qs: Array
    p_WReleased: Array
    inserting: Situation
    lowering: Situation


class PlaceSearch:
    """Finds places and counts what placements are rejected by."""

    def __init__(self, world: CollisionWorld, target: PerceivedObject) -> None:
        self._world = world
        self._target = target
        self.rejected: Counter[str] = Counter()

    def find(self, pick: Pick, placement: Placement, qs: Array) -> Place | None:
        """Return a place for the object held by `pick`.

        Args:
            pick: how the object is held.
            placement: where it goes.
            qs: (M, 7) solutions for the gripper at the goal, tried in this order.
        """
        reason = "IK"
        for q in qs:
            place, reason = self._from_configuration(q, pick, placement)
            if place is not None:
                return place
        self.rejected[reason] += 1
        return None

    def _from_configuration(
        self, q: Array, pick: Pick, placement: Placement
    ) -> tuple[Place | None, str]:
        lowering = self._holding(pick, placement, placement.lower_contacts, MAX_LOWERING_M)
        inserting = self._holding(pick, placement, placement.insert_contacts, 0.0)
        if not self._world.free(q[None], lowering)[0]:
            return None, "collision at the goal"
        X_WG = place_grasp(placement.X_WOgoal, placement.X_WO, pick.X_WG)
        start, lowest = (
            shifted(X_WG, (0.0, 0.0, height))
            for height in (placement.lower_from_m, placement.lower_to_m)
        )
        lower = follow(q, polyline([start, lowest], LINE_STEP_M / 2.0))
        if lower is None:
            return None, "IK of the lowering"
        if not self._world.path_free(lower, lowering):
            return None, "collision while lowering"
        insert = self._insertion(lower[0], X_WG, start, placement, inserting)
        if insert is None:
            return None, "insertion"
        retreat, released = self._retreat(lower[-1], lowest, pick)
        if retreat is None:
            return None, "retreat"
        return Place(placement, lowest, insert, lower, retreat, released, inserting, lowering), ""

    def _holding(
        self,
        pick: Pick,
        placement: Placement,
        contacts: frozenset[AllowedContact],
        lowering_m: float,
    ) -> Situation:
        """Return the situation of the held object, lowered by up to `lowering_m`."""
        obstacles = self._target.p_WObstacles
        exempt = None
        if AllowedContact.HELD_PEG in contacts:
            exempt = peg_tube(obstacles, placement.X_WO, placement.X_WOgoal, lowering_m)
        return Situation(
            pick.held_width_m,
            p_GHeld=pick.held(obstacles),
            peg_exempt=exempt,
            allowed=contacts,
        )

    def _insertion(
        self, q: Array, X_WG: Array, X_WGstart: Array, placement: Placement, inserting: Situation
    ) -> Array | None:
        """Return (I, 7) from the first entry that works to the start of the lowering, at `q`."""
        carrying = Situation(inserting.opening_m, p_GHeld=inserting.p_GHeld)
        for p_OEntry_W in placement.p_OEntries_W:
            out = follow(q, straight_line(X_WGstart, shifted(X_WG, p_OEntry_W), LINE_STEP_M))
            if out is None or not self._world.free(out[-1:], carrying)[0]:
                continue
            path = np.concatenate([out[::-1], q[None]])
            if self._world.path_free(path, inserting):
                return path
        return None

    def _retreat(self, q: Array, X_WGlowest: Array, pick: Pick) -> tuple[Array | None, Array]:
        """Return (R, 7) back from the released object, and the object's points (N, 3) then."""
        released = transform_points(X_WGlowest, pick.held(self._target.p_WObstacles))
        back = follow(q, straight_line(X_WGlowest, backed_off(X_WGlowest, APPROACH_M), LINE_STEP_M))
        if back is None:
            return None, released
        path = np.concatenate([q[None], back])
        touching = frozenset({AllowedContact.FINGERS_TARGET})
        letting_go = Situation(pick.release_m, p_WStanding=released, allowed=touching)
        if not self._world.path_free(path, letting_go):
            return None, released
        if not self._world.free(path[-1:], Situation(pick.release_m, p_WStanding=released))[0]:
            return None, released
        return path, released
