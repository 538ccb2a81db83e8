"""From paths to the named, timed segments of a plan."""

from dataclasses import dataclass

from planning.motion import timed
from planning.perceived import PerceivedObject
from planning.pick import Pick
from planning.place import Place
from planning.problem import AllowedContact, Segment, SegmentName
from planning.timing import CAREFUL, FEELING, FREE, LOADED, Speed, rest
from planning.world import CollisionWorld, Situation
from split_drake.gripper import MAX_FORCE_N
from split_drake.poses import Array

# The fingers close and open slowly: at full speed pads tunnel into thin walls.
FINGER_SPEED_M_S = 0.1
# Commanded below zero, so that the force limit acts on whatever is between the pads.
SQUEEZE_M = -0.05
SETTLE_S = 0.2

_FINGERS = frozenset({AllowedContact.FINGERS_TARGET})
_ON_TABLE = frozenset({AllowedContact.HELD_TABLE})


@dataclass(frozen=True)
class Route:
    """The motions between a plan's straight lines, each (N, 7).

    Attributes:
        transit_qs: from the start to the pregrasp.
        transfer_qs: from the lifted object to the insertion.
        away_qs: from the retreat's end on, away from the object; None to stay there.
    """

    transit_qs: Array
    transfer_qs: Array
    away_qs: Array | None


def plan_segments(
    world: CollisionWorld, target: PerceivedObject, pick: Pick, place: Place, route: Route
) -> tuple[Segment, ...]:
    """Return the segments of a whole pick and place, in their order."""
    opening = pick.opening_m
    before = Situation(opening, p_WStanding=target.p_WObstacles)
    carrying = Situation(opening, p_GHeld=pick.held(target.p_WObstacles))
    after = Situation(pick.release_m, p_WStanding=place.p_WReleased)
    grip = _Builder(world)
    contacts = place.placement.contacts
    segments = [
        grip.empty(SegmentName.TRANSIT, route.transit_qs, FREE, before),
        grip.empty(SegmentName.APPROACH, pick.approach_qs, CAREFUL, _allowing(before, _FINGERS)),
        _close(pick, opening),
        grip.loaded(SegmentName.LIFT, pick.lift_qs, CAREFUL, _allowing(carrying, _ON_TABLE)),
        grip.loaded(SegmentName.TRANSFER, route.transfer_qs, LOADED, carrying),
        grip.loaded(SegmentName.INSERT, place.insert_qs, CAREFUL, place.inserting),
        grip.loaded(SegmentName.INSERT, place.lower_qs, FEELING, place.inserting, feel=True),
        _open(place, pick.release_m, contacts),
        grip.empty(SegmentName.RETREAT, place.retreat_qs, CAREFUL, _allowing(after, _FINGERS)),
    ]
    if route.away_qs is not None:
        segments.append(grip.empty(SegmentName.TRANSIT, route.away_qs, FREE, after))
    return tuple(segments)


@dataclass(frozen=True)
class _Builder:
    """Times paths and makes segments of them."""

    world: CollisionWorld

    def empty(self, name: SegmentName, qs: Array, speed: Speed, situation: Situation) -> Segment:
        trajectory = timed(self.world, qs, situation, speed)
        return Segment(
            name=name,
            trajectory=trajectory,
            opening_start_m=situation.opening_m,
            opening_end_m=situation.opening_m,
            force_n=MAX_FORCE_N,
            holding=False,
            allowed_contacts=situation.allowed,
        )

    def loaded(
        self,
        name: SegmentName,
        qs: Array,
        speed: Speed,
        situation: Situation,
        feel: bool = False,
    ) -> Segment:
        return Segment(
            name=name,
            trajectory=timed(self.world, qs, situation, speed),
            opening_start_m=SQUEEZE_M,
            opening_end_m=SQUEEZE_M,
            force_n=MAX_FORCE_N,
            holding=True,
            allowed_contacts=situation.allowed,
            stop_on_contact=feel,
        )


def _allowing(situation: Situation, contacts: frozenset[AllowedContact]) -> Situation:
    return Situation(situation.opening_m, situation.p_WStanding, situation.p_GHeld, None, contacts)


def _close(pick: Pick, opening_m: float) -> Segment:
    duration = (opening_m - SQUEEZE_M) / FINGER_SPEED_M_S + SETTLE_S
    return Segment(
        name=SegmentName.CLOSE,
        trajectory=rest(pick.approach_qs[-1], duration),
        opening_start_m=opening_m,
        opening_end_m=SQUEEZE_M,
        force_n=MAX_FORCE_N,
        holding=False,
        allowed_contacts=_FINGERS,
    )


def _open(place: Place, opening_m: float, contacts: frozenset[AllowedContact]) -> Segment:
    duration = opening_m / FINGER_SPEED_M_S + SETTLE_S
    return Segment(
        name=SegmentName.OPEN,
        trajectory=rest(place.lower_qs[-1], duration),
        opening_start_m=0.0,
        opening_end_m=opening_m,
        force_n=MAX_FORCE_N,
        holding=False,
        allowed_contacts=_FINGERS | contacts,
    )
