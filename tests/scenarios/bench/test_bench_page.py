"""The page of a bench."""

from scenarios.bench.page import page_of
from scenarios.bench.plan_measures import PlanMeasures
from scenarios.bench.records import SOLVED, BenchRecord
from split_drake.experiments.pages.render import render

PLAN = PlanMeasures(12.0, 9.5, 20.0, 0.0153)
RECORDS = [
    BenchRecord("hang-split-test-0", "default", SOLVED, "", 0.8, 0.7, PLAN, subgoal="hang"),
    BenchRecord("hang-split-test-0", "gcs", "planning", "no <regions>", 2.0, 1.9, subgoal="hang"),
]


def test_each_problem_has_a_row_for_each_planner() -> None:
    page = page_of(RECORDS, {"problems": "mugs.npz", "commit": "a" * 40})
    assert [row.key for row in page.rows] == ["hang-split-test-0-gcs", "hang-split-test-0-default"]
    assert [bar.shown.partition(" ")[0] for bar in page.bars] == ["1/1", "0/1"]
    assert [cell.value for cell in page.rows[1].cells[5:]] == [0.8, 12.0, 9.5, 15.3]
    assert [cell.value for cell in page.rows[0].cells[5:]] == [2.0, None, None, None]
    shown = render(page)
    assert "no &lt;regions&gt;" in shown and "a" * 12 in shown
