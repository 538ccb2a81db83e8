"""Trial records, rates and reports."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.trials.records import (
    TrialRecord,
    failures_by_stage,
    median_seconds,
    total_redraws,
    trial_run,
)
from scenarios.trials.report.page import page_of, write_report
from scenarios.trials.report.summary import rates_by_width, summarize
from split_drake.experiments.pages.render import render
from split_drake.experiments.run import json_line
from split_drake.experiments.statistics import Rate

CONFIG = {
    "task": "hang",
    "detector": "oracle",
    "planner": "default",
    "mugs": "test",
    "seed": 0,
    "trials": 4,
}
GOOD = TrialRecord(
    index=0,
    seed=0,
    mug="test_000",
    mug_diameter_m=0.07,
    outcome="success",
    attempts=({"subgoal": "hang", "stage": "success", "reason": ""},),
    redraws={"upside down": 2},
    seconds={"planning": 1.0},
    recording="recordings/000.html",
)
BAD = replace(GOOD, index=1, mug_diameter_m=0.1, outcome="grasp", reason="it <slipped>", seconds={})


def test_records_come_back_in_order(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    path.write_text("".join(json_line(record) + "\n" for record in (BAD, GOOD)))
    assert trial_run(tmp_path).records() == [BAD, GOOD]
    assert trial_run(tmp_path / "none").records() == []


def test_a_line_cut_off_by_a_kill_is_left_out_but_damage_is_not(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    path.write_text(json_line(GOOD) + "\n" + json_line(BAD)[:40])
    assert trial_run(tmp_path).records() == [GOOD]
    path.write_text(json_line(BAD)[:40] + "\n" + json_line(GOOD) + "\n")
    with pytest.raises(ValueError, match="jsonl:1"):
        trial_run(tmp_path).records()


def test_wilson_interval_of_a_known_case() -> None:
    # The paper's 28 of 40: Wilson's formula by hand.
    n, p, z = 40, 28 / 40, 1.959964
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    assert Rate(28, 40).wilson95 == pytest.approx((middle - half, middle + half), abs=1e-6)
    assert Rate(0, 0).wilson95 == (0.0, 1.0)
    assert str(Rate(28, 40)) == "28/40 = 70.0%  [55%, 82%]"


def test_figures() -> None:
    slow = replace(GOOD, index=2, seconds={"planning": 3.0})
    assert failures_by_stage([GOOD, BAD, BAD]) == {"grasp": 2}
    assert median_seconds([GOOD, BAD, slow]) == {"planning": 2.0}
    assert total_redraws([GOOD, GOOD]) == {"upside down": 4}
    rates = rates_by_width([GOOD, BAD, slow])
    assert [(r.successes, r.trials) for r in rates.values()] == [(2, 3), (2, 2), (0, 1)]


def test_summary_has_what_it_promises() -> None:
    summary = summarize([GOOD, BAD], CONFIG, wall_s=12.0)
    promised = {"task", "detector", "planner", "seed", "trials", "successes", "rate", "wilson95"}
    assert promised | {"failures", "median_s", "wall_s"} <= set(summary)
    assert (summary["successes"], summary["trials"], summary["rate"]) == (1, 2, 0.5)
    assert summary["failures"] == {"grasp": 1}


def test_checked_plans_are_counted_and_their_violations_told(tmp_path: Path) -> None:
    checked = replace(GOOD, index=2, violations=())
    colliding = replace(GOOD, index=3, violations=("transfer: hand and hook overlap",))
    summary = summarize([GOOD, checked, colliding], CONFIG, wall_s=1.0)
    assert summary["plans_checked_in"] == 2
    assert summary["violations"] == {"3": ("transfer: hand and hook overlap",)}
    path = tmp_path / "trials.jsonl"
    path.write_text("".join(json_line(r) + "\n" for r in (GOOD, checked, colliding)))
    assert trial_run(tmp_path).records() == [GOOD, checked, colliding]


def test_reports_of_nothing_are_valid(tmp_path: Path) -> None:
    write_report(tmp_path, [], CONFIG, wall_s=0.0)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["rate"] is None
    assert summary["trials"] == 0
    assert "no trials" in (tmp_path / "index.html").read_text()


def test_the_index_links_recordings_and_escapes_reasons() -> None:
    page = render(page_of([GOOD, BAD], CONFIG | {"mugs": "a < b"}))
    assert "a &lt; b" in page
    assert 'href="recordings/000.html"' in page
    assert "it &lt;slipped&gt;" in page
    assert "<slipped>" not in page
