"""What a run comes to: a table, summary.json and index.html."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from scenarios.trials.records import (
    WIDE_MUG_M,
    TrialRecord,
    failures_by_stage,
    median_seconds,
    success_rate,
    total_redraws,
    worst_peaks,
)
from scenarios.viewing.page import link, table_page, text, verdict
from split_drake.experiments.statistics import Rate
from split_drake.files import write_atomically, write_json


def rates_by_width(records: Sequence[TrialRecord]) -> dict[str, Rate]:
    """Return the rate over all mugs, over those that fit between the fingers, and the wider."""
    narrow = [r for r in records if r.mug_diameter_m <= WIDE_MUG_M]
    wide = [r for r in records if r.mug_diameter_m > WIDE_MUG_M]
    width_mm = round(1000 * WIDE_MUG_M)
    return {
        "all mugs": success_rate(records),
        f"mugs up to {width_mm} mm": success_rate(narrow),
        "wider mugs": success_rate(wide),
    }


def summarize(
    records: Sequence[TrialRecord], config: Mapping[str, Any], wall_s: float
) -> dict[str, Any]:
    """Return the content of summary.json; `trials` counts the trials that ended."""
    rate = success_rate(records)
    return {
        **{key: config[key] for key in ("task", "detector", "planner", "mugs", "seed")},
        "trials": rate.trials,
        "trials_asked_for": config["trials"],
        "successes": rate.successes,
        "rate": rate.value if rate.trials else None,
        "wilson95": rate.wilson95,
        "by_width": {
            name: {"successes": r.successes, "trials": r.trials, "wilson95": r.wilson95}
            for name, r in rates_by_width(records).items()
        },
        "failures": failures_by_stage(records),
        "redraws": total_redraws(records),
        "median_s": median_seconds(records),
        "limits_exceeded": {str(r.index): r.exceeded for r in records if r.exceeded},
        "worst_peaks": worst_peaks(records),
        "plans_checked_in": sum(r.violations is not None for r in records),
        "violations": {str(r.index): r.violations for r in records if r.violations},
        "wall_s": wall_s,
    }


def print_report(console: Console, records: Sequence[TrialRecord], title: str) -> None:
    """Print rates, failures and times."""
    rates = Table(title=title, title_justify="left")
    rates.add_column("")
    rates.add_column("successes [Wilson 95%]")
    for name, rate in rates_by_width(records).items():
        rates.add_row(name, str(rate))
    console.print(rates)
    checked = sum(record.violations is not None for record in records)
    for name, figures in (
        ("failures by stage", failures_by_stage(records)),
        ("starts drawn again", total_redraws(records)),
        (
            "limits exceeded in trials",
            {record.index: " and ".join(record.exceeded) for record in records if record.exceeded},
        ),
        ("worst of all trials", worst_peaks(records)),
        (
            f"violations in plans ({checked} trials checked)",
            {record.index: "; ".join(record.violations) for record in records if record.violations},
        ),
        ("median seconds", {k: f"{v:.2f}" for k, v in median_seconds(records).items()}),
    ):
        listed = ", ".join(f"{key} {value}" for key, value in figures.items())
        console.print(f"{name}: {listed or 'none'}")


def _row(record: TrialRecord) -> tuple[str, ...]:
    return (
        text(record.index),
        text(record.mug),
        text(f"{1000 * record.mug_diameter_m:.0f} mm"),
        verdict(record.outcome, record.succeeded),
        text(record.reason),
        verdict(", ".join(record.exceeded), good=False),
        link(record.recording, "replay"),
    )


def index_page(records: Sequence[TrialRecord], title: str) -> str:
    """Return an HTML page that lists the trials and links their recordings."""
    heads = ("trial", "mug", "diameter", "outcome", "reason", "limits exceeded", "")
    rates = [f"{name}: {rate}" for name, rate in rates_by_width(records).items()]
    return table_page(title, rates, heads, [_row(record) for record in records])


def write_report(
    folder: Path, records: Sequence[TrialRecord], config: Mapping[str, Any], wall_s: float
) -> None:
    """Write summary.json and index.html, atomically."""
    write_json(folder / "summary.json", summarize(records, config, wall_s))
    write_atomically(folder / "index.html", index_page(records, run_title(config)))


def run_title(config: Mapping[str, Any]) -> str:
    """Return a line that names a run."""
    return "{task} with {detector}, {mugs} mugs, seed {seed}".format(**config)
