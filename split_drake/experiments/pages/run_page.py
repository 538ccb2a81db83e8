"""What a run's page shows: facts, rates, plots, and a table whose rows open.

Whatever kind of run it is, it is put into these words; `render` makes a page of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from split_drake.experiments.statistics import Rate


@dataclass(frozen=True)
class Bar:
    """A share with its interval.

    Attributes:
        name: what it is a share of.
        value: in [0, 1].
        interval: 95%.
        shown: in words.
    """

    name: str
    value: float
    interval: tuple[float, float]
    shown: str

    @classmethod
    def of(cls, name: str, rate: Rate) -> "Bar":
        """Return the bar of a rate."""
        return cls(name, rate.value if rate.trials else 0.0, rate.wilson95, str(rate))


@dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes:
        title: its head.
        numeric: whether it is sorted as numbers.
        chosen: whether the page offers its values to choose from.
    """

    title: str
    numeric: bool = False
    chosen: bool = False


@dataclass(frozen=True)
class Cell:
    """A cell of the table.

    Attributes:
        value: what it is sorted, searched and chosen by; None where there is nothing.
        shown: in words; the value itself where empty.
        good: whether it is in the colour of what went well, or not; None for neither.
    """

    value: str | float | None
    shown: str = ""
    good: bool | None = None


@dataclass(frozen=True)
class Piece:
    """A part of an attempt.

    Attributes:
        name: of the segment.
        seconds: that it took.
        felt: what was measured in it, in words.
        good: False where it was cut short.
    """

    name: str
    seconds: float
    felt: str = ""
    good: bool = True


@dataclass(frozen=True)
class Track:
    """An attempt as a line of time.

    Attributes:
        title: what was attempted.
        outcome: what became of it.
        good: whether that was what was wanted.
        pieces: one after the other.
        facts: (name, value) of what belongs to it.
    """

    title: str
    outcome: str
    good: bool
    pieces: tuple[Piece, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Link:
    """A file beside the page.

    Attributes:
        target: relative to the page.
        shown: in words.
    """

    target: str
    shown: str


@dataclass(frozen=True)
class Row:
    """A row of the table: one trial, round or problem.

    Attributes:
        key: by which a link finds it, unique in a page.
        good: whether it came to what was wanted.
        cells: as many as there are columns.
        thumbnail: a picture in the row; None for none.
        stills: pictures in what opens.
        tracks: attempts.
        links: to its files.
        record: all that is kept of it.
    """

    key: str
    good: bool
    cells: tuple[Cell, ...]
    thumbnail: Link | None = None
    stills: tuple[Link, ...] = ()
    tracks: tuple[Track, ...] = ()
    links: tuple[Link, ...] = ()
    record: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RunPage:
    """A page.

    Attributes:
        title: of the run.
        facts: (name, value) of what was run.
        bars: rates.
        plots: pictures, as elements of a page.
        columns: of the table.
        rows: of it, those that failed first.
        thing: what a row is of: "trial".

    Raises ValueError where a row has not a cell for each column, or two rows have one key.
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    bars: tuple[Bar, ...]
    plots: tuple[str, ...]
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    thing: Literal["trial", "round", "problem", "pair", "scene", "setting"]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row.cells) != len(self.columns):
                raise ValueError(
                    f"row {row.key} has {len(row.cells)} cells; expected {len(self.columns)}"
                )
        if len({row.key for row in self.rows}) < len(self.rows):
            raise ValueError("two rows have the same key; expected one each")


def failures_first(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return the rows, those that failed before the others, in their order else."""
    return tuple(sorted(rows, key=lambda row: row.good))
