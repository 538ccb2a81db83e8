"""Where the object of a subgoal must end: the judge's own tests, apart from what makes placements.

Every file in `planning/checking/goals` has a constant GOAL_CHECK, the test of one subgoal.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache

from planning.problem import Plan, PlanningProblem
from split_drake.experiments.room_files import constants_in


@dataclass(frozen=True)
class GoalCheck:
    """The test of where plans to a subgoal bring an object.

    Attributes:
        subgoal: its name.
        off_goal: where a plan brings the object that is not what the problem asks for; "" where it
            is.
    """

    subgoal: str
    off_goal: Callable[[Plan, PlanningProblem], str] = field(repr=False)


_REGISTERED: dict[str, GoalCheck] = {}


def register_goal_check(check: GoalCheck) -> None:
    """Make a check known in this process; worker processes know those that are files.

    Raises ValueError where the subgoal has one already.
    """
    if check.subgoal in {**checks_in_files(), **_REGISTERED}:
        raise ValueError(f"there is a check of where plans to {check.subgoal} end already")
    _REGISTERED[check.subgoal] = check


@cache
def checks_in_files() -> dict[str, GoalCheck]:
    """Return {subgoal: check} of the files in `planning/checking/goals`.

    Raises ValueError where a file has no GOAL_CHECK, or two have one for the same subgoal.
    """
    return constants_in(
        "planning.checking.goals", "GOAL_CHECK", GoalCheck, lambda check: check.subgoal
    )


def goal_check(subgoal: str) -> GoalCheck:
    """Return the check of a subgoal's ends, or raise ValueError naming those there are."""
    known = {**checks_in_files(), **_REGISTERED}
    if subgoal not in known:
        raise ValueError(_unchecked(subgoal, known))
    return known[subgoal]


def _unchecked(subgoal: str, known: Mapping[str, GoalCheck]) -> str:
    """Return the sentence that says that a subgoal is none of those with a check."""
    return (
        f"nothing says where plans to {subgoal} must end, only those to "
        f"{', '.join(sorted(known))}; expected a file with a GOAL_CHECK of it in "
        "planning/checking/goals"
    )


def require_checks_in_files(subgoals: Iterable[str]) -> None:
    """Raise ValueError for the first subgoal whose check worker processes would not find."""
    for subgoal in subgoals:
        if subgoal not in checks_in_files():
            raise ValueError(_unchecked(subgoal, checks_in_files()))
