"""What a bench comes to: tables and summary.json."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Column, Table

from scenarios.bench.records import BenchRecord
from scenarios.bench.statistics import (
    MEASURES,
    Comparison,
    PairedDifference,
    PlannerSummary,
    by_planner,
    compare_all,
)
from split_drake.files import write_json

# Measure: heading, factor to its unit, digits.
_MEASURES = {
    "duration_s": ("motion, s", 1.0, 1),
    "path_length_rad": ("path length, rad", 1.0, 2),
    "rms_jerk_rad_s3": ("rms jerk, rad/s^3", 1.0, 1),
    "clearance_m": ("clearance, mm", 1e3, 1),
}


def print_bench(console: Console, records: Sequence[BenchRecord], planners: Sequence[str]) -> None:
    """Print a column for each planner of the records, and a row for each pair of `planners`."""
    summaries = {name: PlannerSummary.of(found) for name, found in by_planner(records).items()}
    console.print(_planner_table(summaries))
    for name, summary in summaries.items():
        listed = ", ".join(f"{stage} {count}" for stage, count in summary.failures.items())
        console.print(f"{name}: failures by stage: {listed or 'none'}")
    pairs = compare_all(records, planners)
    if pairs:
        console.print(_pair_table(pairs))
    elif len(planners) > 1:
        console.print(f"no pairs: no problem has been given to all of {', '.join(planners)}")


def write_bench_summary(
    path: Path,
    records: Sequence[BenchRecord],
    planners: Sequence[str],
    config: Mapping[str, Any],
) -> None:
    """Write summary.json, atomically: the configuration, each planner, each pair of `planners`."""
    found = by_planner(records)
    content = {
        **config,
        "planners": {
            name: {
                **asdict(summary := PlannerSummary.of(own)),
                "wilson95": {group: rate.wilson95 for group, rate in summary.groups.items()},
            }
            for name, own in found.items()
        },
        "pairs": [asdict(pair) for pair in compare_all(records, planners)],
    }
    write_json(path, content)


def _planner_table(summaries: Mapping[str, PlannerSummary]) -> Table:
    """Return a table with a column for each planner."""
    title = "times over problems that did not crash, medians of plans over each planner's own"
    table = _table("", *summaries, title=title)
    columns = [_planner_column(summary) for summary in summaries.values()]
    for heading in dict.fromkeys(heading for column in columns for heading in column):
        table.add_row(heading, *(column.get(heading, "-") for column in columns))
    return table


def _planner_column(summary: PlannerSummary) -> dict[str, str]:
    """Return {heading: text}."""
    cells = {
        "problems": str(summary.solved.trials),
        "solved": f"{summary.solved.value:.1%}",
        **{f"  {group}": str(rate) for group, rate in summary.groups.items()},
        "timed": str(summary.timed),
        "planning, median s": _number(summary.median_s, 1.0, 2),
        "planning, p95 s": _number(summary.p95_s, 1.0, 2),
        "planning, median CPU s": _number(summary.median_cpu_s, 1.0, 2),
    }
    for key in MEASURES:
        heading, factor, digits = _MEASURES[key]
        cells[heading] = _number(summary.medians.get(key), factor, digits)
    return cells


def _number(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def _pair_table(pairs: Sequence[Comparison]) -> Table:
    """Return a table with a column for each pair; all rest on the same problems."""
    title = (
        f"pairs on {pairs[0].problems} problems given to all: median differences (p of Wilcoxon's "
        "test), problems taken for independent, p not corrected for the number of pairs"
    )
    table = _table("first - second", *(f"{p.one} - {p.other}" for p in pairs), title=title)
    table.add_row("solved alone", *(f"{pair.only_one} - {pair.only_other}" for pair in pairs))
    table.add_row("McNemar p", *(f"{pair.mcnemar_p:.2g}" for pair in pairs))
    table.add_row("planning, CPU s", *(_difference(pair.cpu_s, 1.0, 2) for pair in pairs))
    table.add_row("both solved", *(str(pair.both) for pair in pairs))
    for key in MEASURES:
        heading, factor, digits = _MEASURES[key]
        table.add_row(heading, *(_difference(p.measures[key], factor, digits) for p in pairs))
    return table


def _difference(figure: PairedDifference, factor: float, digits: int) -> str:
    if not figure.problems:
        return "-"
    p = f"{figure.p:.2g}" if figure.p >= 0.001 else "<.001"
    return f"{factor * figure.median:+.{digits}f} ({p})"


def _table(*headings: str, title: str) -> Table:
    """Return a table that breaks words rather than cutting numbers off."""
    return Table(*(Column(heading, overflow="fold") for heading in headings), title=title)
