"""Where a held object can go: on the hook, or upright on the table."""

from dataclasses import dataclass

from planning.problem import AllowedContact
from split_drake.poses import Array


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
