"""Parts of a run, for clusters without a scheduler: `--shard 2/5` is the second of five."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from split_drake.bad_input import BadInputError
from split_drake.experiments.run import require_same

# What a part may have otherwise than the others.
_OWN = ("shard", "out", "workers", "scheduler", "record", "limit_s")


@dataclass(frozen=True)
class Shard:
    """A part of a run.

    Attributes:
        number: which of them, from 1 on.
        count: how many there are.
    """

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the part that is written as "2/5"; BadInputError where none is."""
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise BadInputError(f"--shard is {text!r}; expected such as 2/5, from 1/5 to 5/5")
        return cls(int(found[1]), int(found[2]))

    def takes(self, index: int) -> bool:
        """Return whether an item, numbered from 0 on, belongs to it: parts take items in turns."""
        return index % self.count == self.number - 1

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def require_parts(configs: Mapping[Path, Mapping[str, Any]]) -> list[str]:
    """Return which parts of one run are not among `configs`, by their folders.

    Raises BadInputError, naming the folder, where one is of a whole run, of another number of
    parts, or the same part as another; and AnotherRunError where one was asked for something else.
    """
    first_folder, first = next(iter(configs.items()))
    parts: dict[Shard, Path] = {}
    for folder, config in configs.items():
        if not config.get("shard"):
            raise BadInputError(f"{folder} is no part of a run; expected runs made with --shard")
        require_same(folder, first, config, (*_OWN, "commit", "processor"))
        part = Shard.parse(str(config["shard"]))
        if part.count != Shard.parse(str(first["shard"])).count:
            raise BadInputError(f"{folder} is part {part}, {first_folder} {first['shard']}")
        if part in parts:
            raise BadInputError(f"{folder} and {parts[part]} are both part {part}")
        parts[part] = folder
    count = next(iter(parts)).count
    there = {part.number for part in parts}
    return [f"{number}/{count}" for number in range(1, count + 1) if number not in there]


def require_own(shard: str | None, indices: Sequence[int], folder: Path) -> None:
    """Raise BadInputError naming the first item, numbered from 0 on, that is of another part."""
    if shard is None:
        return
    part = Shard.parse(shard)
    for index in indices:
        if not part.takes(index):
            raise BadInputError(f"{folder} is part {part}, but holds item {index} of another part")
