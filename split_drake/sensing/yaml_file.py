"""YAML and JSON files as ROS, OpenCV, RealSense and this project write them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from split_drake.bad_input import LARGEST, BadInputError
from split_drake.files import MissingFileError, UnreadableFileError

Fields = Mapping[str, Any]


class _Loader(yaml.SafeLoader):
    """Reads OpenCV's matrices as mappings of rows, cols, dt and data."""


def _matrix(loader: yaml.SafeLoader, node: yaml.Node) -> Any:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.YAMLError("an opencv-matrix has no rows, cols and data")
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def read_yaml(path: Path | str, what: str) -> Fields:
    """Return the mapping that a YAML or JSON file holds.

    Args:
        path: of the file.
        what: the file should be, for the message: "a camera's calibration".

    Raises MissingFileError, and UnreadableFileError where it is no YAML or no mapping.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}; expected {what}")
    try:
        # OpenCV begins with "%YAML:1.0", which is no directive that YAML knows.
        text = path.read_text(encoding="utf-8").removeprefix("%YAML:1.0")
        # Of several documents, as `rostopic echo` writes them, the first is taken.
        content = next(iter(yaml.load_all(text, _Loader)), None)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        told = ascii(" ".join(str(error).split())[:300])[1:-1]
        raise UnreadableFileError(f"{path} is damaged or not {what}: {told}") from error
    if not isinstance(content, dict):
        raise UnreadableFileError(f"{path} holds no names with values; expected {what}")
    return content


def require_keys(
    fields: object, where: str, known: Sequence[str], needed: Sequence[str] = ()
) -> Fields:
    """Return `fields`, or raise BadInputError naming a key that is not known, or is missing."""
    if not isinstance(fields, Mapping):
        raise BadInputError(f"{where} is {fields!r:.60}; expected {', '.join(known)}")
    if unknown := [key for key in fields if key not in known]:
        raise BadInputError(f"{where} has {unknown[0]!r}; expected {', '.join(known)}")
    if missing := [key for key in needed if key not in fields]:
        raise BadInputError(f"{where} has no {missing[0]!r}; expected {', '.join(needed)}")
    return fields


def numbers(value: object, count: int, where: str) -> list[float]:
    """Return a list of so many finite numbers, or raise BadInputError naming `where`."""
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    values: list[Any] = list(value) if listed else [value]  # type: ignore[call-overload]
    good = all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)
    if not good or len(values) != count or not all(abs(v) <= LARGEST for v in values):
        raise BadInputError(f"{where} is {value!r:.80}; expected {count} numbers")
    return [float(v) for v in values]
