"""The bench's figures, pairs and tables, of made-up records."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest
from rich.console import Console

from scenarios.bench.plan_measures import PlanMeasures
from scenarios.bench.records import BenchRecord, BenchTask, crashed_task
from scenarios.bench.report import print_bench
from scenarios.bench.statistics import (
    MEASURES,
    PairedDifference,
    PlannerSummary,
    compare,
    compare_all,
)
from scenarios.planner_bench import BenchOptions, missing_tasks
from split_drake.experiments.run import as_json
from split_drake.experiments.statistics import mcnemar_exact

SEED = (0, 0)


def made_up(problem: int, planner: str, solved: bool, cpu_s: float = 1.0) -> BenchRecord:
    measures = PlanMeasures(10.0, 5.0 + cpu_s, 30.0, 0.01) if solved else None
    outcome = "solved" if solved else "planning"
    return BenchRecord(f"p{problem}", planner, outcome, "", 2.0 * cpu_s, cpu_s, measures)


def test_summaries_count_and_take_medians() -> None:
    records = [made_up(i, "a", solved=i < 8, cpu_s=float(i)) for i in range(10)]
    summary = PlannerSummary.of(records)
    assert (summary.solved.successes, summary.solved.trials) == (8, 10)
    assert summary.median_cpu_s == 4.5
    assert summary.median_s == 9.0
    assert summary.p95_s == pytest.approx(17.1)
    assert summary.medians["path_length_rad"] == 8.5
    assert summary.failures == {"planning": 2}
    assert PlannerSummary.of([made_up(0, "a", solved=False)]).medians == {}


def test_shares_are_those_of_groups_and_unknown_times_no_times() -> None:
    names = ("hang-split-test-0", "hang-split-test-1", "hang-oracle-test-0", "odd one")
    records = [replace(made_up(i, "a", i != 1), problem=name) for i, name in enumerate(names)]
    records.append(crashed_task(BenchTask(Path(), "odd two", "hang", "a", SEED)))
    summary = PlannerSummary.of(records)
    assert {group: (r.successes, r.trials) for group, r in summary.groups.items()} == {
        "hang-split-test": (1, 2),
        "hang-oracle-test": (1, 1),
        "unnumbered": (1, 1),
        "hang-unnumbered": (0, 1),
    }
    assert (summary.median_s, summary.median_cpu_s) == (2.0, 1.0)
    assert (summary.timed, PlannerSummary.of(records[-1:]).median_s) == (4, None)


def test_planners_take_turns_at_going_first() -> None:
    options = BenchOptions(planner=("rrt", "gcs"), seed=3)
    done = [made_up(2, "rrt", solved=True)]
    tasks = missing_tasks(options, dict.fromkeys(("p0", "p1", "p2"), "hang"), done)
    assert [(task.problem, task.planner) for task in tasks] == [
        ("p0", "rrt"),
        ("p0", "gcs"),
        ("p1", "gcs"),
        ("p1", "rrt"),
        ("p2", "gcs"),
    ]
    assert [task.seed for task in tasks[1:4]] == [(3, 0), (3, 1), (3, 1)]
    assert {task.subgoal for task in tasks} == {"hang"}


def test_groups_are_of_the_problems_subgoals_whatever_their_names_say() -> None:
    names = {"scene-0": "hang", "scene-1": "reorient", "reorient-0": "hang", "hang-split-0": "hang"}
    records = [
        replace(made_up(i, "a", True), problem=name, subgoal=subgoal)
        for i, (name, subgoal) in enumerate(names.items())
    ]
    groups = PlannerSummary.of(records).groups
    assert list(groups) == ["hang-scene", "reorient-scene", "hang-reorient", "hang-split"]


def test_records_that_were_written_without_their_subgoal_are_read() -> None:
    fields = as_json(asdict(made_up(0, "a", True)))
    del fields["subgoal"]
    assert BenchRecord.from_fields(fields) == made_up(0, "a", True)


def test_pairs_are_compared_on_shared_problems_alone() -> None:
    ones = [made_up(i, "a", solved=True, cpu_s=1.0 + 0.01 * i) for i in range(10)]
    others = [made_up(i, "b", solved=i > 5, cpu_s=2.0) for i in range(9)]
    pair = compare(ones + others, "a", "b")
    assert (pair.only_one, pair.only_other) == (6, 0)
    assert pair.mcnemar_p == pytest.approx(2.0 * 0.5**6)
    assert pair.cpu_s.problems == 9
    assert pair.cpu_s.median == pytest.approx(-0.96)
    assert pair.cpu_s.p < 0.01
    assert {name: figure.problems for name, figure in pair.measures.items()} == dict.fromkeys(
        MEASURES, 3
    )


def test_all_pairs_rest_on_the_problems_that_all_planners_were_given() -> None:
    done = {"a": 10, "b": 8, "c": 3}
    records = [made_up(i, name, solved=True) for name, n in done.items() for i in range(n)]
    pairs = compare_all(records, tuple(done))
    assert [(p.one, p.other, p.problems) for p in pairs] == [
        ("a", "b", 3),
        ("a", "c", 3),
        ("b", "c", 3),
    ]
    assert compare_all(records, ("a", "b", "not begun")) == []


def test_nothing_to_compare_is_no_difference() -> None:
    assert mcnemar_exact(0, 0) == 1.0
    assert PairedDifference.of([], []).problems == 0
    assert PairedDifference.of([1.0, 2.0], [1.0, 2.0]).p == 1.0


def test_the_table_names_planners_shares_and_failures() -> None:
    console = Console(record=True, width=90)
    records = [made_up(i, name, solved=i < n) for name, n in (("a", 3), ("b", 0)) for i in range(4)]
    records += [made_up(4, "a", solved=True)]
    print_bench(console, records, ("a", "b"))
    text = console.export_text()
    problems = next(line for line in text.splitlines() if "problems  " in line)
    assert problems.replace("│", " ").split() == ["problems", "5", "4"]
    assert "pairs on 4 problems" in " ".join(text.split())
    assert "4/5 = 80.0%" in text
    assert "b: failures by stage: planning 4" in text
    assert "a - b" in text
