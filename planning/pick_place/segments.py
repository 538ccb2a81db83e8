"""From paths to the named, timed segments of a plan."""

from dataclasses import dataclass, replace

from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject
from planning.motion.segment_builder import (
    SegmentBuilder,
    closing_segment,
    executed_s,
    opening_segment,
    settled,
)
from planning.motion.timing import CAREFUL, FEELING, FREE, LOADED, RETREATING
from planning.pick_place.pick import Pick
from planning.pick_place.place import Place
from planning.problem import Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array

_FINGERS = frozenset({AllowedContact.FINGERS_TARGET})


@dataclass(frozen=True)
class Route:
    """The motions between a plan's straight lines, each (N, 7).

    Attributes:
        transit_qs: from the start to the pregrasp; None where the object is in the hand already.
        transfer_qs: from the lifted object to the insertion.
        away_qs: from the retreat's end on, away from the object; None to stay there.
    """

    transit_qs: Array | None
    transfer_qs: Array
    away_qs: Array | None


def moves_after(segments: tuple[Segment, ...], released_s: float) -> bool:
    """Return whether the arm still moves so long after the hand has opened."""
    names = [segment.name for segment in segments]
    after = segments[names.index(SegmentName.OPEN) + 1 :]
    return sum(executed_s(segment) for segment in after) > released_s


def shortened(segments: tuple[Segment, ...], released_s: float) -> tuple[Segment, ...]:
    """Return the segments, without the withdrawal at their end where the arm moves too long."""
    withdraws = segments[-1].name is SegmentName.TRANSIT
    return segments[:-1] if withdraws and moves_after(segments, released_s) else segments


def plan_segments(
    world: CollisionWorld, target: PerceivedObject, pick: Pick, place: Place, route: Route
) -> tuple[Segment, ...]:
    """Return the segments of a pick and place, in their order; of the place alone if so routed."""
    carrying = Situation(pick.held_width_m, p_GHeld=pick.held(target.p_WObstacles))
    after = Situation(pick.release_m, p_WStanding=place.p_WReleased)
    grip = SegmentBuilder(world)
    segments = [
        *_pick_segments(grip, target, pick, route.transit_qs),
        grip.loaded(SegmentName.TRANSFER, route.transfer_qs, LOADED, carrying),
        settled(grip.loaded(SegmentName.INSERT, place.insert_qs, CAREFUL, place.inserting)),
        grip.loaded(SegmentName.INSERT, place.lower_qs, FEELING, place.lowering, feel=True),
        _open(place, pick),
        grip.empty(SegmentName.RETREAT, place.retreat_qs, RETREATING, _allowing(after, _FINGERS)),
    ]
    if route.away_qs is not None:
        segments.append(grip.empty(SegmentName.TRANSIT, route.away_qs, FREE, after))
    return tuple(segments)


def _pick_segments(
    grip: "SegmentBuilder", target: PerceivedObject, pick: Pick, transit_qs: Array | None
) -> tuple[Segment, ...]:
    if transit_qs is None:
        return ()
    before = Situation(pick.opening_m, p_WStanding=target.p_WObstacles)
    return (
        grip.empty(SegmentName.TRANSIT, transit_qs, FREE, before),
        grip.empty(SegmentName.APPROACH, pick.approach_qs, CAREFUL, _allowing(before, _FINGERS)),
        closing_segment(pick.approach_qs[-1], pick.opening_m, pick.held_width_m, _FINGERS),
        grip.loaded(SegmentName.LIFT, pick.lift_qs, CAREFUL, pick.lifting),
    )


def _allowing(situation: Situation, contacts: frozenset[AllowedContact]) -> Situation:
    return replace(situation, allowed=contacts)


def _open(place: Place, pick: Pick) -> Segment:
    contacts = _FINGERS | place.placement.lower_contacts
    return opening_segment(place.lower_qs[-1], pick.release_m, pick.held_width_m, contacts)
