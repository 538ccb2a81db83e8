"""The page of a study: a row for each setting that was tried, with what it came to."""

from collections.abc import Mapping, Sequence
from typing import Any

from split_drake.experiments.pages.run_page import Cell, Column, Row, RunPage
from split_drake.experiments.provenance import git_commit, processor, short_hash

Figures = Mapping[str, str | float | None]


def study_page(
    title: str,
    rows: Sequence[Figures],
    settings: Sequence[str],
    facts: Mapping[str, object] | None = None,
    plots: Sequence[str] = (),
    records: Sequence[Mapping[str, Any]] = (),
) -> RunPage:
    """Return the page of a study.

    Args:
        title: of it.
        rows: {head: text, or a number that the table is sorted by}, with the same heads in each.
        settings: heads whose values the page offers to choose from.
        facts: {name: value} of what all rows share; those without a value are left out.
        plots: pictures, as `RunPage` has them.
        records: all that is kept of each row; what the row shows, where none is given.

    Raises ValueError where a row has other heads than the first.
    """
    heads = list(rows[0]) if rows else []
    for row in rows:
        if list(row) != heads:
            raise ValueError(f"a row has the heads {list(row)}; expected {heads}")
    columns = tuple(
        Column(head, all(not isinstance(row[head], str) for row in rows), head in settings)
        for head in heads
    )
    shown = {name: str(value) for name, value in (facts or {}).items() if value not in (None, "")}
    return RunPage(
        title=title,
        facts=tuple(shown.items()),
        bars=(),
        plots=tuple(plots),
        columns=columns,
        rows=tuple(
            Row(str(number), True, tuple(map(_cell, row.values())), record=dict(record))
            for number, (row, record) in enumerate(zip(rows, records or rows, strict=True), start=1)
        ),
        thing="setting",
    )


def _cell(value: str | float | None) -> Cell:
    return Cell(round(value, 4) if isinstance(value, float) else value)


def made_with() -> dict[str, str]:
    """Return the commit and the processor, for the facts of a page."""
    return {"commit": short_hash(git_commit()), "processor": processor()}


def picture(name: str) -> str:
    """Return a picture that lies beside the page, and opens by a click."""
    return f'<a href="{name}"><img src="{name}" alt="{name.rpartition(".")[0]}"></a>'
