"""What is wrong with a plan."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Violation:
    """A contact that no segment declares, a motion that the arm cannot make, or a goal missed.

    Attributes:
        segment: number of the segment, from 0; None for the plan as a whole.
        name: of the segment, or "plan".
        what: is wrong, with the values.
    """

    segment: int | None
    name: str
    what: str

    def __str__(self) -> str:
        number = "" if self.segment is None else f" ({self.segment})"
        return f"{self.name}{number}: {self.what}"
