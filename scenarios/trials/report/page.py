"""The page of a run of trials: rates, plots, and every trial with its attempts."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from scenarios.trials.records import TrialRecord, failures_by_stage, median_seconds
from scenarios.trials.report.summary import rates_by_width, run_title, summarize
from split_drake.experiments.pages.plots import bars_of, rates_along
from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import (
    Bar,
    Cell,
    Column,
    Link,
    Piece,
    Row,
    RunPage,
    Track,
    failures_first,
)
from split_drake.experiments.provenance import short_hash
from split_drake.files import write_atomically, write_json

_COLUMNS = (
    Column("trial", numeric=True),
    Column("mug", chosen=True),
    Column("diameter, mm", numeric=True),
    Column("outcome", chosen=True),
    Column("attempts", numeric=True),
    Column("why, or what it recovered from"),
    Column("planning, s", numeric=True),
    Column("execution, s", numeric=True),
)
# A replay of a failure begins so long before what was executed last had ended.
BEFORE_FAILURE_S = 4.0
# Edges of the mugs' widths that rates are shown for, mm.
_WIDTHS_MM = (0.0, 60.0, 70.0, 76.0, 85.0, 95.0, 130.0)


def write_report(
    folder: Path, records: Sequence[TrialRecord], config: Mapping[str, Any], wall_s: float
) -> None:
    """Write summary.json and index.html, atomically."""
    write_json(folder / "summary.json", summarize(records, config, wall_s))
    write_atomically(folder / "index.html", render(page_of(records, config)))


def page_of(records: Sequence[TrialRecord], config: Mapping[str, Any]) -> RunPage:
    """Return the page of a run."""
    return RunPage(
        title=run_title(config),
        facts=_facts(records, config),
        bars=tuple(Bar.of(name, rate) for name, rate in rates_by_width(records).items()),
        plots=_plots(records),
        columns=_COLUMNS,
        rows=failures_first([row_of(record) for record in records]),
        thing="trial",
    )


def _facts(
    records: Sequence[TrialRecord], config: Mapping[str, Any]
) -> tuple[tuple[str, str], ...]:
    """Return what was run, and with what."""
    last = config["seed"] + config["trials"] - 1
    options = ("planner", "noise_m", "depth_noise", "station", "objects", "feedback", "check_plans")
    asked = {
        "seeds": f"{config['seed']} to {last}",
        **{name: config.get(name) for name in options if config.get(name)},
        "weights": short_hash(config.get("checkpoint_sha256")),
        "commit": short_hash(config.get("commit")),
        "processor": config.get("processor"),
    }
    recovered = sum(record.succeeded and len(record.attempts) > 1 for record in records)
    found = {
        "recovered": f"{recovered} trials succeeded after a failed attempt, a look or a new plan",
        "median seconds": ", ".join(f"{k} {v:.1f}" for k, v in median_seconds(records).items()),
    }
    both = asked | found
    return tuple((name, str(value)) for name, value in both.items() if value)


def _plots(records: Sequence[TrialRecord]) -> tuple[str, ...]:
    """Return the plots as SVG: rates by width, failures by stage, times."""
    widths = [1e3 * record.mug_diameter_m for record in records]
    successes = [record.succeeded for record in records]
    plots = [rates_along("diameter of the mug, mm", widths, successes, _WIDTHS_MM)]
    if failures := failures_by_stage(records):
        plots.append(bars_of("failures by stage", failures))
    if times := median_seconds(records):
        plots.append(bars_of("median seconds", times))
    return tuple(plots)


def row_of(record: TrialRecord) -> Row:
    """Return a trial's row."""
    troubles = [str(each["reason"]) for each in record.attempts if each.get("reason")]
    said = record.reason or "; ".join(dict.fromkeys(troubles))
    exceeded = [f"beyond a limit: {each}" for each in record.exceeded]
    stills = tuple(Link(file, shown) for file, shown in record.stills)
    return Row(
        key=str(record.index),
        good=record.succeeded,
        cells=(
            Cell(record.index),
            Cell(record.mug),
            Cell(round(1e3 * record.mug_diameter_m)),
            Cell(record.outcome, good=record.succeeded),
            Cell(len(record.attempts)),
            Cell("; ".join([each for each in (said, *exceeded) if each])),
            _seconds(record, "planning"),
            _seconds(record, "execution"),
        ),
        thumbnail=stills[-1] if stills else None,
        stills=stills,
        tracks=tuple(track_of(number, each) for number, each in enumerate(record.attempts, 1)),
        links=links_of(record),
        record=asdict(record),
    )


def links_of(record: TrialRecord) -> tuple[Link, ...]:
    """Return links to a trial's replay, of a failure from shortly before it on, and to its film."""
    links = []
    if record.recording:
        ends = [each["segments"][-1]["ended_s"] for each in record.attempts if each.get("segments")]
        if ends and not record.succeeded:
            moment_s = max(0.0, float(ends[-1]) - BEFORE_FAILURE_S)
            links.append(Link(f"{record.recording}#t={moment_s:.1f}", "failure"))
        links.append(Link(record.recording, "replay"))
    if record.film:
        links.append(Link(record.film, "film"))
    return tuple(links)


def _seconds(record: TrialRecord, stage: str) -> Cell:
    found = record.seconds.get(stage)
    return Cell(None) if found is None else Cell(round(found, 2), f"{found:.1f}")


def track_of(number: int, attempt: Mapping[str, Any]) -> Track:
    """Return an attempt's line of time."""
    good = attempt["stage"] == "success"
    outcome = "done" if good else f"{attempt['stage']}: {attempt['reason']}"
    held = attempt.get("held") or {}
    facts = {
        "then": attempt.get("recovery"),
        "objects in view": attempt.get("objects_in_view"),
        "poses found": ", ".join(f"{k} {v}" for k, v in (attempt.get("poses") or {}).items()),
        "planning": f"{attempt.get('planning_s', 0.0):.1f} s",
        "in the hand": _held(held) if held else "",
    }
    return Track(
        title=f"attempt {number}, {attempt['subgoal']}",
        outcome=outcome,
        good=good,
        pieces=tuple(_piece(segment) for segment in attempt.get("segments", ())),
        facts=tuple((name, str(value)) for name, value in facts.items() if value),
    )


def _held(held: Mapping[str, Any]) -> str:
    """Return how the object was seen to lie in the hand."""
    if held.get("rejected"):
        return str(held["rejected"])
    turn_deg = 57.29577951308232 * float(held["turn_rad"])
    return f"moved {1e3 * float(held['shift_m']):.1f} mm, turned {turn_deg:.1f} degrees"


def _piece(segment: Mapping[str, Any]) -> Piece:
    felt = [f"fingers {1e3 * segment['opening_m']:.0f} mm apart"]
    if segment["force_n"]:
        felt.append(f"{segment['force_n']:.1f} N")
    if segment["stopped_by_contact"]:
        felt.append("stopped by what it felt")
    return Piece(
        str(segment["name"]),
        float(segment["duration_s"]),
        ", ".join(felt),
        # Being stopped is what lowering by feel ends with, and is shown as such.
        good=not segment["stopped_by_contact"] or segment["name"] == "insert",
    )
