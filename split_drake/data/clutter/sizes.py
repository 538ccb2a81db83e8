"""Objects in several sizes, as clutter is seen in several: VGN scales its objects by 0.7 to 1.0."""

from dataclasses import dataclass, replace

import numpy as np

from split_drake.bad_input import require_numbers
from split_drake.objects.procedural.split import ProceduralSource, Split
from split_drake.objects.task_object import ObjectSource, TaskObject

_MARK = "*"


@dataclass(frozen=True)
class SizedSource:
    """Each object of a source in `count` sizes, one from each equal part of the range.

    Attributes:
        source: of the objects; hashable where this is to be.
        count: of sizes.
        scales: range of the factors that they are scaled by.
    """

    source: ObjectSource
    count: int = 2
    scales: tuple[float, float] = (0.7, 1.0)

    def __post_init__(self) -> None:
        require_numbers(self)
        low, high = self.scales
        if self.count < 1 or not 0.0 < low <= high:
            raise ValueError(
                f"count={self.count}, scales={self.scales}; "
                "expected at least one size, and 0 < lowest <= highest"
            )

    def names(self) -> tuple[str, ...]:
        """Return the names of all copies, such as "bottle_3*0", all first sizes first."""
        return tuple(
            f"{name}{_MARK}{size}" for size in range(self.count) for name in self.source.names()
        )

    def load(self, name: str) -> TaskObject:
        """Return the copy of that name; it has no task's poses.

        Raises ValueError where there is none.
        """
        of, mark, size = name.rpartition(_MARK)
        if not mark or not size.isdecimal() or int(size) >= self.count:
            raise ValueError(
                f"there is no object {name!r}; expected a name with {_MARK}0 to "
                f"{_MARK}{self.count - 1} after it"
            )
        shape = self.source.load(of)
        low, high = self.scales
        share = np.random.default_rng([*shape.seed, int(size)]).random()
        factor = low + (high - low) * (int(size) + share) / self.count
        return TaskObject(body=replace(shape.body.scaled(factor), name=name))

    def sha256(self) -> str:
        """Return a hash of what the copies are made from."""
        low, high = self.scales
        return f"{self.source.sha256()}{_MARK}{self.count}x{low:g}-{high:g}"


def clutter_source(split: Split) -> SizedSource:
    """Return the procedural objects of a split, in the sizes that clutter is made of."""
    return SizedSource(ProceduralSource(split))
