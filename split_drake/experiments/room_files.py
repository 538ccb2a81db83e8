"""What lies in a room as a file each, found by listing its folder: subgoals, checks, planners."""

from collections.abc import Callable, Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import TypeVar

Value = TypeVar("Value")


def modules_in(room: str) -> Iterator[ModuleType]:
    """Import every file of a room, such as "planning.goals", and yield them by name."""
    for module in iter_modules(import_module(room).__path__):
        yield import_module(f"{room}.{module.name}")


def constants_in(
    room: str, constant: str, kind: type[Value], name_of: Callable[[Value], str]
) -> dict[str, Value]:
    """Return {name: value} of the constants that the files of a room must have.

    Raises ValueError where a file has none, and where two files have one of the same name.

    Args:
        room: such as "planning.goals".
        constant: what every file of it calls its own.
        kind: of the constant.
        name_of: the name that a value is found by.
    """
    found: dict[str, Value] = {}
    files: dict[str, str] = {}
    for module in modules_in(room):
        value = getattr(module, constant, None)
        if not isinstance(value, kind):
            raise ValueError(
                f"{file_of(module)} has no constant {constant}; expected a {kind.__name__} of that "
                f"name in every file of {room}"
            )
        name = name_of(value)
        if name in found:
            raise ValueError(
                f"{files[name]} and {file_of(module)} both have a {kind.__name__} for {name!r}; "
                "expected one"
            )
        found[name], files[name] = value, file_of(module)
    return found


def file_of(module: ModuleType) -> str:
    """Return the path of a module's file, as messages name it."""
    return str(module.__file__)
