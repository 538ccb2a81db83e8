"""What a run comes to: a table and summary.json."""

from collections.abc import Mapping, Sequence
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
from split_drake.experiments.statistics import Rate


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


def run_title(config: Mapping[str, Any]) -> str:
    """Return a line that names a run."""
    return "{task} with {detector}, {mugs} mugs, seed {seed}".format(**config)
