"""What is raised where something that a user gave cannot be used, and checks of numbers."""

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

# No number of this project is beyond it; 1e38 is no measure of anything here.
LARGEST = 1e12
_WHOLE = (int, np.integer)
_REAL = (*_WHOLE, float, np.floating)


class BadInputError(ValueError):
    """Something that was given cannot be used; the message names it, and what was expected.

    Commands print the message alone, without a traceback.
    """


def require_number(
    name: str, value: object, least: float = -LARGEST, most: float = LARGEST, meaning: str = ""
) -> None:
    """Raise BadInputError where a value is no number from `least` to `most`, NaN say.

    `meaning` says in the message what the number is: "a standard deviation in metres".
    """
    if isinstance(value, bool) or not isinstance(value, _REAL) or not least <= value <= most:
        told = f", {meaning}" if meaning else ""
        raise BadInputError(f"{name} is {value!r}; expected a number{_range(least, most)}{told}")


def require_count(name: str, value: object, least: int = 0, most: float = LARGEST) -> None:
    """Raise BadInputError where a value is no whole number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, _WHOLE) or not least <= value <= most:
        raise BadInputError(f"{name} is {value!r}; expected a whole number{_range(least, most)}")


def _range(least: float, most: float) -> str:
    if least > -LARGEST and most < LARGEST:
        return f" from {least:g} to {most:g}"
    if least > -LARGEST:
        return f", {least:g} or more"
    return f", {most:g} or less" if most < LARGEST else " that is finite"


def require_numbers(record: "DataclassInstance", flags: bool = False) -> None:
    """Raise BadInputError where a field of a dataclass is not the number that it is declared to be.

    NaN, infinity and 1e38 are none, and 1.5 is no `int`.  Seeds are 0 or more.  Of nested
    dataclasses each checks its own fields.  With `flags` they are named as on a command line.
    """
    for entry in fields(record):
        value = getattr(record, entry.name)
        name = f"--{entry.name.replace('_', '-')}" if flags else entry.name
        if value is None and entry.type in (int | None, float | None):
            continue
        if entry.name.endswith("seed"):
            require_count(name, value, most=float("inf"))
        elif entry.type in (int, int | None):
            require_count(name, value, least=-int(LARGEST))
        elif entry.type in (float, float | None):
            require_number(name, value)
        elif isinstance(value, (tuple, list)):
            for item in value:
                if isinstance(item, float):
                    require_number(name, item)
