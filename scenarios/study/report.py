"""The physics study's table: a row a cell, to print, as Markdown and as JSON."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from scenarios.study.cells import Cell
from scenarios.study.trials import StudyRecord
from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import RunPage
from split_drake.experiments.pages.study_page import made_with, study_page
from split_drake.experiments.statistics import Rate, mcnemar_exact
from split_drake.files import write_atomically, write_json

HEADS = {
    "hold": ("held", "pads deep", "slip", "turn", "times real time", "failures"),
    "hang": ("hung", "against default", "failures"),
}


@dataclass(frozen=True)
class Row:
    """A cell's results.

    Attributes:
        cell: simulated.
        rate: of trials that ended well.
        figures: of holds, {name: (median, largest)}; hands that ended empty have none.
        failures: {outcome: count}.
        p_paired: McNemar's exact test against the default's trials with the same seeds; None for
            the default itself.
    """

    cell: Cell
    rate: Rate
    figures: dict[str, tuple[float, float]]
    failures: dict[str, int]
    p_paired: float | None

    def texts(self) -> tuple[str, ...]:
        """Return the row's texts under HEADS."""
        failed = ", ".join(f"{name} {count}" for name, count in self.failures.items())
        if self.cell.kind == "hang":
            against = "" if self.p_paired is None else f"p = {self.p_paired:.2g}"
            return str(self.rate), against, failed
        if not self.figures:
            return str(self.rate), "", "", "", "", failed
        return (
            str(self.rate),
            _spread(self.figures["penetration_m"], 1e3, "mm"),
            _spread(self.figures["slip_m"], 1e3, "mm"),
            _spread(self.figures["turn_rad"], np.degrees(1.0), "deg"),
            f"{self.figures['real_time_factor'][0]:.1f}",
            failed,
        )

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON's types."""
        return {
            "cell": self.cell.name,
            "successes": self.rate.successes,
            "trials": self.rate.trials,
            "wilson95": self.rate.wilson95,
            "median_and_largest": self.figures,
            "failures": self.failures,
            "p_paired": self.p_paired,
        }


def _spread(figure: tuple[float, float], scale: float, unit: str) -> str:
    median, largest = (scale * value for value in figure)
    return f"{median:.2f} (at most {largest:.2f}) {unit}"


def study_rows(cells: Sequence[Cell], records: Sequence[StudyRecord]) -> list[Row]:
    """Return a row for each cell."""
    by_cell = {
        cell.name: {record.index: record for record in records if record.cell == cell.name}
        for cell in cells
    }
    defaults = {cell.kind: by_cell[cell.name] for cell in cells if cell.factor is None}
    return [_row(cell, by_cell[cell.name], defaults[cell.kind]) for cell in cells]


def _row(cell: Cell, found: Mapping[int, StudyRecord], default: Mapping[int, StudyRecord]) -> Row:
    records = list(found.values())
    measured = [record.figures for record in records if "slip_m" in record.figures]
    names = measured[0] if measured else {}
    return Row(
        cell=cell,
        rate=Rate.of(record.succeeded for record in records),
        figures={
            name: (
                float(np.median([each[name] for each in measured])),
                float(np.max([each[name] for each in measured])),
            )
            for name in names
        },
        failures=dict(Counter(r.outcome for r in records if not r.succeeded).most_common()),
        p_paired=None if cell.factor is None else paired_p(found, default),
    )


def paired_p(one: Mapping[int, StudyRecord], other: Mapping[int, StudyRecord]) -> float:
    """Return McNemar's exact p-value over the trials that both have; 1 where none differs."""
    pairs = [(one[i].succeeded, other[i].succeeded) for i in one.keys() & other.keys()]
    better, worse = pairs.count((True, False)), pairs.count((False, True))
    return mcnemar_exact(better, worse)


def print_study(console: Console, rows: Sequence[Row]) -> None:
    """Print one table for holds and one for trials."""
    for kind, heads in HEADS.items():
        table = Table("changed", "to", *heads, title=_title(kind), title_justify="left")
        for row in rows:
            if row.cell.kind == kind:
                table.add_row(row.cell.factor or "nothing", row.cell.value, *row.texts())
        console.print(table)


def write_study(folder: Path, rows: Sequence[Row]) -> None:
    """Write study.json, study.md and index.html."""
    write_json(folder / "study.json", [row.to_json() for row in rows])
    parts = []
    for kind, heads in HEADS.items():
        lines = [("changed", "to", *heads), ("---",) * (len(heads) + 2)]
        lines += [
            (row.cell.factor or "nothing", row.cell.value, *row.texts())
            for row in rows
            if row.cell.kind == kind
        ]
        table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        parts.append(f"## {_title(kind)}\n\n{table}\n")
    write_atomically(folder / "study.md", "\n".join(parts))
    trials = max((row.rate.trials for row in rows), default=0)
    write_atomically(folder / "index.html", render(page_of(rows, trials)))


def page_of(rows: Sequence[Row], trials: int) -> RunPage:
    """Return the study's page: holds and trials in one table, which offers the kind."""
    heads = list(dict.fromkeys(head for heads in HEADS.values() for head in heads))
    shown = []
    for row in rows:
        found = dict(zip(HEADS[row.cell.kind], row.texts(), strict=True))
        setting = {"of": row.cell.kind, "changed": row.cell.factor or "nothing"}
        to = {"to": str(row.cell.value)}
        shown.append({**setting, **to, **{head: found.get(head, "") for head in heads}})
    return study_page(
        "what the physics is worth",
        shown,
        settings=("of", "changed"),
        facts={"trials of a setting": trials, **made_with()},
        records=[row.to_json() for row in rows],
    )


def _title(kind: str) -> str:
    if kind == "hold":
        return "A mug held still: median and largest, but for hands that ended empty"
    return "Pick and hang with true poses, the same seeds in every row"
