"""The page of a run of clutter removal: rates, plots, and every round with its grasps."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from scenarios.clutter.records import (
    EMPTIED,
    GraspRecord,
    Removal,
    RoundRecord,
    Share,
    kind_of_failure,
)
from split_drake.experiments.pages.plots import bars_of
from split_drake.experiments.pages.run_page import (
    Bar,
    Cell,
    Column,
    Link,
    Row,
    RunPage,
    Track,
    failures_first,
)
from split_drake.experiments.provenance import short_hash

_COLUMNS = (
    Column("round"),
    Column("seed", numeric=True, chosen=True),
    Column("taken", numeric=True),
    Column("of", numeric=True),
    Column("grasps failed", numeric=True),
    Column("ended", chosen=True),
    Column("why grasps failed"),
    Column("seconds", numeric=True),
)
# Of the options, those that the page repeats, in their order.
_ASKED = ("scene", "robot", "detector", "noise", "fit_table", "select", "objects")


def page_of(records: Sequence[RoundRecord], config: Mapping[str, Any], title: str) -> RunPage:
    """Return the page of a run."""
    removal = Removal.of(records)
    return RunPage(
        title=title,
        facts=_facts(removal, config),
        bars=(
            _bar("grasps that succeeded (GSR)", removal.gsr),
            _bar("objects taken (DR)", removal.dr),
        ),
        plots=tuple(
            bars_of(name, counts)
            for name, counts in (
                ("rounds by how they ended", removal.ended),
                ("grasps by why they failed", removal.failures),
            )
            if counts
        ),
        columns=_COLUMNS,
        rows=failures_first([row_of(record) for record in records]),
        thing="round",
    )


def _facts(removal: Removal, config: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    counts = f"{removal.rounds} rounds, {removal.objects} objects, {removal.attempts} grasps"
    asked = {name: config[name] for name in _ASKED if config.get(name)}
    rest = {
        "weights": short_hash(config.get("checkpoint_sha256")),
        "commit": short_hash(config.get("commit")),
        "processor": config.get("processor"),
    }
    return tuple(
        (name, str(value)) for name, value in ({"tried": counts} | asked | rest).items() if value
    )


def _bar(name: str, share: Share) -> Bar:
    value = share.value if share.value == share.value else 0.0  # NaN of nothing
    return Bar(name, value, share.interval, str(share))


def row_of(record: RoundRecord) -> Row:
    """Return a round's row."""
    failed = [grasp for grasp in record.grasps if not grasp.succeeded]
    reasons = dict.fromkeys(kind_of_failure(grasp.reason) for grasp in failed)
    return Row(
        key=f"{record.seed}-{record.index}",
        good=record.ended == EMPTIED,
        cells=(
            Cell(f"{record.seed}-{record.index}"),
            Cell(record.seed),
            Cell(record.successes),
            Cell(len(record.objects)),
            Cell(len(failed)),
            Cell(record.ended, good=record.ended == EMPTIED),
            Cell("; ".join([*reasons, *([record.detail] if record.detail else [])])),
            Cell(round(record.wall_s, 1)),
        ),
        tracks=tuple(track_of(number, each) for number, each in enumerate(record.grasps, 1)),
        links=(Link(record.recording, "replay"),) if record.recording else (),
        record=asdict(record),
    )


def track_of(number: int, grasp: GraspRecord) -> Track:
    """Return what became of a grasp."""
    facts = {
        "score": f"{grasp.score:.2f}, the best of {grasp.candidates}",
        "touched on the way in": ", ".join(grasp.stopped_by),
        "pushed off the table": ", ".join(grasp.lost),
    }
    taken = f"took {', '.join(grasp.taken)}"
    return Track(
        title=f"grasp {number}",
        outcome=taken if grasp.succeeded else grasp.reason,
        good=grasp.succeeded,
        facts=tuple((name, value) for name, value in facts.items() if value),
    )
