"""What a bench comes to: tables and summary.json."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import combinations
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from scenarios.bench_records import BenchRecord
from scenarios.bench_statistics import Comparison, PlannerSummary, by_planner, compare
from scenarios.files import write_json

# Columns of the medians over solved problems: measure, heading, factor to its unit, digits.
_MEASURES = (
    ("path_length_rad", "path, rad", 1.0, 2),
    ("duration_s", "motion, s", 1.0, 1),
    ("rms_jerk_rad_s3", "rms jerk, rad/s\u00b3", 1.0, 1),
    ("clearance_m", "clearance, mm", 1e3, 1),
)


def print_bench(console: Console, records: Sequence[BenchRecord]) -> None:
    """Print a row for each planner, and one for each pair of them."""
    summaries = {name: PlannerSummary.of(found) for name, found in by_planner(records).items()}
    console.print(_planner_table(summaries))
    for name, summary in summaries.items():
        listed = ", ".join(f"{stage} {count}" for stage, count in summary.failures.items())
        console.print(f"{name}: failures by stage: {listed or 'none'}")
    pairs = [compare(records, *pair) for pair in combinations(summaries, 2)]
    if pairs:
        console.print(_pair_table(pairs))


def write_bench_summary(
    path: Path, records: Sequence[BenchRecord], config: Mapping[str, Any]
) -> None:
    """Write summary.json, atomically."""
    found = by_planner(records)
    content = {
        **config,
        "planners": {
            name: {**asdict(summary := PlannerSummary.of(own)), "wilson95": summary.solved.wilson95}
            for name, own in found.items()
        },
        "pairs": [asdict(compare(records, *pair)) for pair in combinations(found, 2)],
    }
    write_json(path, content)


def _planner_table(summaries: Mapping[str, PlannerSummary]) -> Table:
    table = Table(title="medians over solved problems; times over all", title_justify="left")
    headings = [heading for _, heading, _, _ in _MEASURES]
    for heading in ("planner", "solved [Wilson 95%]", "plan, s", "p95, s", "CPU, s", *headings):
        table.add_column(heading)
    for name, summary in summaries.items():
        times = (summary.median_s, summary.p95_s, summary.median_cpu_s)
        measures = [
            f"{factor * summary.medians[key]:.{digits}f}" if summary.medians else "-"
            for key, _, factor, digits in _MEASURES
        ]
        table.add_row(name, str(summary.solved), *(f"{t:.2f}" for t in times), *measures)
    return table


def _pair_table(pairs: Sequence[Comparison]) -> Table:
    table = Table(title="pairs: first minus second, on the same problems", title_justify="left")
    for heading in ("pair", "solved by one alone", "McNemar p", "CPU, s", "path, rad"):
        table.add_column(heading)
    for pair in pairs:
        table.add_row(
            f"{pair.one} - {pair.other}",
            f"{pair.only_one} - {pair.only_other}",
            f"{pair.mcnemar_p:.2g}",
            f"{pair.cpu_s.median:+.2f} (Wilcoxon p {pair.cpu_s.p:.2g})",
            f"{pair.path_length_rad.median:+.2f} (Wilcoxon p {pair.path_length_rad.p:.2g})",
        )
    return table
