"""What a recording says while it plays: which attempt and segment it is, and what is felt."""

from dataclasses import asdict, dataclass, field
from typing import Any

# How often forces are kept.
_FORCES_PER_SECOND = 10.0


@dataclass(frozen=True)
class Caption:
    """A part of a recording.

    Attributes:
        start_s: when it begins; it ends where the next one begins.
        attempt: its number, from 1 on.
        name: of the segment.
        near: whether the hand is near what it handles, so that the view comes closer.
    """

    start_s: float
    attempt: int
    name: str
    near: bool


@dataclass
class Narration:
    """The words of a recording.

    Attributes:
        title: what is tried.
        outcome: what became of it; set at the end.
        good: whether that is what was wanted.
        captions: in the order of time.
        forces: (time, left, right) of the fingers, newtons, inwards.
    """

    title: str
    outcome: str = ""
    good: bool = False
    captions: list[Caption] = field(default_factory=list)
    forces: list[tuple[float, float, float]] = field(default_factory=list)

    def tell(self, time_s: float, attempt: int, name: str, near: bool) -> None:
        """Begin a caption, where it differs from the last one."""
        last = self.captions[-1] if self.captions else None
        if last is None or (last.attempt, last.name) != (attempt, name):
            self.captions.append(Caption(round(time_s, 3), attempt, name, near))

    def feel(self, time_s: float, left_n: float, right_n: float) -> bool:
        """Keep the fingers' forces, where enough time has passed; return whether they were kept."""
        if self.forces and time_s - self.forces[-1][0] < 1.0 / _FORCES_PER_SECOND - 1e-9:
            return False
        self.forces.append((round(time_s, 2), round(left_n, 1), round(right_n, 1)))
        return True

    def to_json(self) -> dict[str, Any]:
        """Return the words as JSON holds them."""
        return asdict(self)
