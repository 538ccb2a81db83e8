"""The page of two runs: their rates, whether they differ, and each scene's two outcomes."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from scenarios.clutter.page import track_of as grasp_track
from scenarios.clutter.records import EMPTIED, RoundRecord
from scenarios.tables.comparison import FIGURES, compare_rounds
from scenarios.tables.table import NAMES
from scenarios.trials.records import TrialRecord
from scenarios.trials.report.page import track_of as attempt_track
from split_drake.experiments.pages.run_page import Bar, Cell, Column, Link, Row, RunPage, Track
from split_drake.experiments.statistics import Rate, mcnemar_exact

_COLUMNS = (
    Column("seed"),
    Column("what"),
    Column("change", chosen=True),
    Column("first", chosen=True),
    Column("second", chosen=True),
    Column("first: why"),
    Column("second: why"),
)
SAME, BETTER, WORSE = "same", "better", "worse"


def trials_page(
    pairs: Sequence[tuple[TrialRecord, TrialRecord]],
    names: tuple[str, str],
    differ: Mapping[str, tuple[Any, Any]],
    places: tuple[Path, Path],
) -> RunPage:
    """Return the page of two runs of trials.

    Args:
        pairs: of each seed that both have.
        names: of the runs.
        differ: what they were asked for differently.
        places: their folders, relative to the page.
    """
    only = [sum(a.succeeded > b.succeeded for a, b in pairs)]
    only.append(sum(b.succeeded > a.succeeded for a, b in pairs))
    verdict = (
        f"{only[0]} succeed in the first alone, {only[1]} in the second alone; "
        f"McNemar's exact p {mcnemar_exact(*only):.3g}"
    )
    rates = [Rate.of(each[number].succeeded for each in pairs) for number in (0, 1)]
    return RunPage(
        title=f"{names[0]} and {names[1]}",
        facts=(("trials that both have", str(len(pairs))), ("difference", verdict), *_told(differ)),
        bars=tuple(Bar.of(name, rate) for name, rate in zip(names, rates, strict=True)),
        plots=(),
        columns=_COLUMNS,
        rows=_changed_first([_trial_row(a, b, places) for a, b in pairs]),
        thing="pair",
    )


def rounds_page(
    pairs: Sequence[tuple[RoundRecord, RoundRecord]],
    names: tuple[str, str],
    differ: Mapping[str, tuple[Any, Any]],
    places: tuple[Path, Path],
) -> RunPage:
    """Return the page of two runs of clutter removal; see `trials_page`."""
    first, second = ([each[number] for each in pairs] for number in (0, 1))
    facts = [("rounds that both have", str(len(pairs)))]
    bars = []
    for figure in FIGURES:
        found = compare_rounds(second, first, figure)
        low, high = (100.0 * each for each in found.interval)
        facts.append(
            (
                NAMES[figure],
                f"the second {100.0 * found.difference:+.1f} points [{low:+.1f}, {high:+.1f}], "
                f"p {found.p:.3g} (paired bootstrap over rounds)",
            )
        )
        for name, value in zip(names, (found.other_share, found.share), strict=True):
            bars.append(Bar(f"{name}, {figure.upper()}", value, (value, value), f"{value:.1%}"))
    return RunPage(
        title=f"{names[0]} and {names[1]}",
        facts=(*facts, *_told(differ)),
        bars=tuple(bars),
        plots=(),
        columns=_COLUMNS,
        rows=_changed_first([_round_row(a, b, places) for a, b in pairs]),
        thing="pair",
    )


def _told(differ: Mapping[str, tuple[Any, Any]]) -> tuple[tuple[str, str], ...]:
    return tuple((name, f"{ours} → {theirs}") for name, (ours, theirs) in differ.items())


def _changed_first(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return what became worse, then what became better, then the rest."""
    order = {WORSE: 0, BETTER: 1, SAME: 2}
    return tuple(sorted(rows, key=lambda row: order[str(row.cells[2].value)]))


def _row(
    key: str,
    what: str,
    change: str,
    outcomes: tuple[Cell, Cell],
    reasons: tuple[str, str],
    tracks: tuple[Track, ...],
    links: tuple[Link, ...],
    records: Mapping[str, Any],
) -> Row:
    good = None if change == SAME else change == BETTER
    cells = (Cell(key), Cell(what), Cell(change, good=good), *outcomes, *map(Cell, reasons))
    return Row(key, change != WORSE, cells, None, (), tracks, links, records)


def _change(first: float, second: float) -> str:
    return SAME if first == second else BETTER if second > first else WORSE


def _trial_row(first: TrialRecord, second: TrialRecord, places: tuple[Path, Path]) -> Row:
    both = (first, second)
    tracks = [
        Track(f"{name}: {track.title}", track.outcome, track.good, track.pieces, track.facts)
        for name, record in zip(("first", "second"), both, strict=True)
        for track in (attempt_track(n, each) for n, each in enumerate(record.attempts, 1))
    ]
    outcomes = tuple(Cell(each.outcome, good=each.succeeded) for each in both)
    return _row(
        str(first.seed),
        first.mug,
        _change(first.succeeded, second.succeeded),
        (outcomes[0], outcomes[1]),
        (first.reason, second.reason),
        tuple(tracks),
        _links([each.recording for each in both], places),
        {"first": asdict(first), "second": asdict(second)},
    )


def _round_row(first: RoundRecord, second: RoundRecord, places: tuple[Path, Path]) -> Row:
    both = (first, second)
    tracks = [
        Track(f"{name}: {track.title}", track.outcome, track.good, track.pieces, track.facts)
        for name, record in zip(("first", "second"), both, strict=True)
        for track in (grasp_track(n, each) for n, each in enumerate(record.grasps, 1))
    ]
    outcomes = tuple(
        Cell(f"{each.successes}/{len(each.objects)}", good=each.ended == EMPTIED) for each in both
    )
    return _row(
        f"{first.seed}-{first.index}",
        f"{len(first.objects)} objects",
        _change(first.successes, second.successes),
        (outcomes[0], outcomes[1]),
        (first.ended, second.ended),
        tuple(tracks),
        _links([each.recording for each in both], places),
        {"first": asdict(first), "second": asdict(second)},
    )


def _links(recordings: Sequence[str | None], places: tuple[Path, Path]) -> tuple[Link, ...]:
    return tuple(
        Link((place / recording).as_posix(), f"{name} replay")
        for name, recording, place in zip(("first", "second"), recordings, places, strict=True)
        if recording
    )


def relative(folder: Path, page: Path) -> Path:
    """Return a folder as a page beside it names it."""
    return Path(os.path.relpath(folder.resolve(), page.resolve().parent))
