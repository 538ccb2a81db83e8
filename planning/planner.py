"""The planner protocol and the registry of planners: every file in `planning/planners` is one."""

from collections.abc import Callable
from types import ModuleType
from typing import Protocol

import numpy as np

from planning.problem import Plan, PlanFailure, PlanningProblem
from split_drake.experiments.room_files import file_of, modules_in


class Planner(Protocol):
    """Turns a problem into a plan.  Seeded by `rng` alone: the same seed gives the same plan."""

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        """Return a plan, or the stage and reason why there is none.

        Where the object is in the hand already, `problem.held_width_m`, the plan begins with the
        TRANSFER from `problem.q_start`.
        """
        ...


_ROOM = "planning.planners"
_FACTORIES: dict[str, Callable[[], Planner]] = {}


def register_planner(name: str) -> Callable[[Callable[[], Planner]], Callable[[], Planner]]:
    """Return a decorator that registers a planner's factory (its class, say) under `name`.

    The decorator raises ValueError where the name is taken.
    """

    def register(factory: Callable[[], Planner]) -> Callable[[], Planner]:
        if not factory.__module__.startswith(f"{_ROOM}."):
            list(modules_in(_ROOM))  # imported, for a name that is taken there is taken
        if name in _FACTORIES:
            raise ValueError(
                f"a planner named {name!r} is registered already, by "
                f"{_FACTORIES[name].__module__}; {factory.__module__} needs another name"
            )
        _FACTORIES[name] = factory
        return factory

    return register


def _load_room() -> None:
    """Import every file in `planning/planners`; raise ValueError where one registers no planner."""
    for module in modules_in(_ROOM):
        if not _registers(module):
            raise ValueError(
                f"{file_of(module)} registers no planner; expected @register_planner in every file "
                f"of {_ROOM}"
            )


def _registers(module: ModuleType) -> bool:
    """Return whether a planner's factory is defined in a module, or named there."""
    named = vars(module).values()
    return any(
        factory.__module__ == module.__name__ or any(factory is value for value in named)
        for factory in _FACTORIES.values()
    )


def planner_names() -> tuple[str, ...]:
    """Return the names of all planners: those in `planning/planners`, and any registered beside."""
    _load_room()
    return tuple(sorted(_FACTORIES))


def make_planner(name: str) -> Planner:
    """Return a new planner of the given name, or raise ValueError naming those there are."""
    names = planner_names()
    if name not in names:
        raise ValueError(f"unknown planner {name!r}; expected one of {list(names)}")
    return _FACTORIES[name]()
