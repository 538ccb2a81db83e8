"""Subgoals: what one pick is for, as values, and the registry that finds them by name.

Every file in `planning/goals` has a constant SUBGOAL, which is one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache

from planning.geometry.perceived import PerceivedObject
from split_drake.bad_input import require_numbers
from split_drake.experiments.room_files import constants_in
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask
from split_drake.poses import Array
from split_drake.station.layout import Layout


class AllowedContact(StrEnum):
    """A contact that a segment declares; everything else must stay clear.

    FINGERS_TARGET: fingers against the object, in the last 8 cm of the approach, while the hand
        closes and opens, and in the first 8 cm of the retreat, of each where several are driven.
    HELD_PEG: the held object against the peg, for points of the object within the tube around the
        peg's axis that its opening leaves; `planning.collision.exemptions` says which.
    HELD_TABLE: the held object against the table, no deeper than `planning.collision.exemptions`
        says, just above where it is lifted from, and where it is let down by feel.
    """

    FINGERS_TARGET = "fingers_target"
    HELD_PEG = "held_peg"
    HELD_TABLE = "held_table"


@dataclass(frozen=True)
class Placement:
    """One way to place an object, whatever it is held by: a goal, a line to it, and its end.

    Attributes:
        X_WO: (4, 4) the frame of the subgoal's task before the pick.
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


@dataclass(frozen=True)
class PlacementQuery:
    """What the placements of an object depend on.

    Attributes:
        poses: detected, of the subgoal's task.
        target: the perceived object.
        layout: of the static station.
        in_hand: whether the object is in the hand already, so that there are fewer pairs to try.
    """

    poses: PoseSet
    target: PerceivedObject
    layout: Layout
    in_hand: bool


@dataclass(frozen=True)
class Subgoal:
    """What one pick is for: a task's poses are brought to goal poses.

    Attributes:
        name: that it is known by in commands, records and files.
        task: whose poses are brought to goals.
        placements: the goals, with the freedom that they leave: one placement for each that is
            worth trying, none where nothing was detected.
        goal_noun: what its goals are called in reports.
        goes_home: whether the arm moves home from the released object, out of the cameras' sight;
            else it draws straight back.
        still_after_s: for how long after the release the arm may move; None for any time.
        seems_reached: whether the subgoal has been reached, as far as its task's poses show when
            the robot looks again; None where a look tells nothing, and an executed plan counts.
        first: a subgoal to reach first where this one cannot be planned; None for none.  It may
            name one to reach before it in turn, and so on.

    Raises ValueError where the subgoals of that chain do not all have different names.
    """

    name: str
    task: PoseTask
    placements: Callable[[PlacementQuery], list[Placement]] = field(repr=False)
    goal_noun: str = "goals"
    goes_home: bool = True
    still_after_s: float | None = None
    seems_reached: Callable[[PoseSet], bool] | None = field(default=None, repr=False)
    first: "Subgoal | None" = None

    def __post_init__(self) -> None:
        require_numbers(self)
        names = [subgoal.name for subgoal in self.chain]
        if len(set(names)) < len(names):
            raise ValueError(
                f"subgoals to reach first are {' -> '.join(names)}; expected each name once"
            )

    def __str__(self) -> str:
        return self.name

    @property
    def tasks(self) -> tuple[PoseTask, ...]:
        """The tasks whose pose sets a planner needs for it."""
        return (GRASP, self.task)

    @property
    def chain(self) -> tuple["Subgoal", ...]:
        """Itself, the subgoal to reach first where it cannot be planned, the one before that..."""
        return (self,) if self.first is None else (self, *self.first.chain)

    @property
    def perceived_tasks(self) -> tuple[PoseTask, ...]:
        """Those, and what the subgoals before it need."""
        return tuple(dict.fromkeys(task for subgoal in self.chain for task in subgoal.tasks))


_REGISTERED: dict[str, Subgoal] = {}


def register_subgoal(subgoal: Subgoal) -> Subgoal:
    """Make a subgoal known by its name, and return it; raise ValueError where the name is taken."""
    if subgoal.name in subgoals():
        raise ValueError(f"a subgoal named {subgoal.name!r} is registered already")
    _REGISTERED[subgoal.name] = subgoal
    return subgoal


@cache
def _in_room() -> dict[str, Subgoal]:
    """Return {name: subgoal} of the files in `planning/goals`.

    Raises ValueError where a file has no SUBGOAL, or two have one of the same name.
    """
    return constants_in("planning.goals", "SUBGOAL", Subgoal, str)


def subgoals() -> dict[str, Subgoal]:
    """Return {name: subgoal} of all that are known."""
    return {**_in_room(), **_REGISTERED}


def find_subgoal(name: str) -> Subgoal:
    """Return the subgoal of that name, or raise ValueError naming those there are."""
    known = subgoals()
    if name not in known:
        raise ValueError(f"unknown subgoal {name!r}; expected one of {', '.join(sorted(known))}")
    return known[name]
