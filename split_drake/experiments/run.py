"""Going on where an interrupted run stopped."""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from split_drake.files import write_json


def claim_folder(folder: Path, config: Mapping[str, Any], free_keys: Collection[str]) -> None:
    """Write config.json.

    Raises ValueError where the folder holds a run made with other options, weights or code; what is
    in `free_keys` may differ.
    """
    path = folder / "config.json"
    if path.exists():
        before = json.loads(path.read_text())
        changed = [
            f"{key} was {before.get(key)!r}, is {value!r}"
            for key, value in config.items()
            if key not in free_keys and before.get(key) != value
        ]
        if changed:
            raise ValueError(f"{folder} holds another run ({'; '.join(changed)}); choose an --out")
    write_json(path, config)


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects in a file of JSON lines; [] where there is no file.

    A last line that was cut off by a kill is left out; any other bad line raises ValueError.
    """
    if not path.exists():
        return []
    lines = path.read_text().split("\n")
    found = []
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError as error:
            if number == len(lines):
                break
            raise ValueError(f"{path}:{number} is not JSON: {error}") from error
    return found
