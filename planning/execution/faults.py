"""What the robot itself notices to have gone wrong while it handles an object."""

from dataclasses import dataclass
from enum import StrEnum

from planning.problem import Segment, SegmentName, Stage

# Fingers closed further than this hold nothing.
EMPTY_OPENING_M = 0.001
# A held object whose width between the pads changes by more than this has slipped or turned.
SLIP_M = 0.002
# A change of the force at the gripper, against the segment's start, that counts as contact: a few
# newtons, below the weight of the lightest mug plus what pressing it down by a millimetre adds.
CONTACT_FORCE_N = 4.0
# One that counts as an obstacle on the way in; up to 25 N were felt where there was none.
BLOCKING_FORCE_N = 35.0
# A force that counts as the object being drawn along by the hand, slow as that moves: two to four
# newtons are felt on a free way.
CATCHING_FORCE_N = 12.0
_FORCE_LIMITS_N = {
    SegmentName.INSERT: BLOCKING_FORCE_N,
    SegmentName.RETREAT: CATCHING_FORCE_N,
    SegmentName.EASE: CATCHING_FORCE_N,
}
# What failed where the hand turns out to be empty after a segment.
LOSS_STAGES = {
    SegmentName.CLOSE: Stage.GRASP,
    SegmentName.LIFT: Stage.GRASP,
    SegmentName.TRANSFER: Stage.TRANSPORT,
    SegmentName.INSERT: Stage.PLACEMENT,
    SegmentName.BACK_OUT: Stage.PLACEMENT,
}


class Fault(StrEnum):
    """What can go wrong; after SLIPPED, BLOCKED and MISSED the object is still in the hand."""

    EMPTY = "empty"
    SLIPPED = "slipped"
    BLOCKED = "blocked"
    CAUGHT = "caught"
    MISSED = "missed"


@dataclass(frozen=True)
class FoundFault:
    """A fault, the stage that failed by it, and the reason in words."""

    fault: Fault
    stage: Stage
    reason: str


def force_limit_n(segment: Segment) -> float:
    """Return the change of the force at the gripper, N, at which the segment is to stop.

    For an open hand in an object it is the force itself, and the executor lets it start with more.
    """
    if segment.stop_on_contact:
        return CONTACT_FORCE_N
    return _FORCE_LIMITS_N.get(segment.name, float("inf"))


def find_fault(
    segment: Segment, stopped: bool, opening_before_m: float, opening_m: float
) -> FoundFault | None:
    """Return what went wrong in a segment, or None.

    Args:
        segment: just executed.
        stopped: whether it ended early, at its force limit.
        opening_before_m, opening_m: measured distance between the pads at its start and end.
    """
    name = segment.name
    if name is SegmentName.RETREAT and stopped:
        reason = f"the hand is caught on the object: more than {CATCHING_FORCE_N:g} N"
        return FoundFault(Fault.CAUGHT, Stage.PLACEMENT, reason)
    if name in LOSS_STAGES and opening_m < EMPTY_OPENING_M:
        closed_mm = 1e3 * max(opening_m, 0.0)
        reason = f"the hand is empty after {name}: its opening is {closed_mm:.1f} mm"
        return FoundFault(Fault.EMPTY, LOSS_STAGES[name], reason)
    if name not in (SegmentName.TRANSFER, SegmentName.INSERT):
        return None
    if stopped and not segment.stop_on_contact:
        reason = f"something is in the way of {name}: more than {BLOCKING_FORCE_N:g} N"
        return FoundFault(Fault.BLOCKED, LOSS_STAGES[name], reason)
    if abs(opening_m - opening_before_m) > SLIP_M:
        change = f"{1e3 * opening_before_m:.1f} mm to {1e3 * opening_m:.1f} mm"
        reason = f"the object slipped during {name}: the opening went from {change}"
        return FoundFault(Fault.SLIPPED, LOSS_STAGES[name], reason)
    return None
