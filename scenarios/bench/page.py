"""The page of a bench: every problem with every planner, and what the plans are like."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from scenarios.bench.records import BenchRecord
from scenarios.bench.statistics import PlannerSummary, by_planner
from split_drake.experiments.pages.plots import bars_of
from split_drake.experiments.pages.run_page import Bar, Cell, Column, Row, RunPage, failures_first
from split_drake.experiments.provenance import short_hash

_COLUMNS = (
    Column("problem"),
    Column("subgoal", chosen=True),
    Column("planner", chosen=True),
    Column("outcome", chosen=True),
    Column("why"),
    Column("planning, s", numeric=True),
    Column("motion, s", numeric=True),
    Column("path, rad", numeric=True),
    Column("clearance, mm", numeric=True),
)


def page_of(records: Sequence[BenchRecord], config: Mapping[str, Any]) -> RunPage:
    """Return the page of a bench's records."""
    summaries = {name: PlannerSummary.of(found) for name, found in by_planner(records).items()}
    medians = {name: each.median_s for name, each in summaries.items() if each.median_s is not None}
    failures = {
        f"{name}: {outcome}": count
        for name, each in summaries.items()
        for outcome, count in each.failures.items()
    }
    facts = {
        "problems": config.get("problems"),
        "problems' hash": short_hash(config.get("problems_sha256")),
        "commit": short_hash(config.get("commit")),
        "processor": config.get("processor"),
    }
    return RunPage(
        title=f"planners {', '.join(summaries)}",
        facts=tuple((name, str(value)) for name, value in facts.items() if value),
        bars=tuple(Bar.of(f"{name} solves", each.solved) for name, each in summaries.items()),
        plots=tuple(
            bars_of(name, values)
            for name, values in (("failures by stage", failures), ("median planning, s", medians))
            if values
        ),
        columns=_COLUMNS,
        rows=failures_first([_row(record) for record in records]),
        thing="problem",
    )


def _row(record: BenchRecord) -> Row:
    plan = record.measures
    return Row(
        key=f"{record.problem}-{record.planner}",
        good=record.solved,
        cells=(
            Cell(record.problem),
            Cell(record.subgoal),
            Cell(record.planner),
            Cell(record.outcome, good=record.solved),
            Cell(record.reason),
            Cell(None if record.planning_s is None else round(record.planning_s, 2)),
            Cell(None if plan is None else round(plan.duration_s, 1)),
            Cell(None if plan is None else round(plan.path_length_rad, 1)),
            Cell(None if plan is None else round(1e3 * plan.clearance_m, 1)),
        ),
        record=asdict(record),
    )
