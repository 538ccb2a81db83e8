"""The page of a run in a browser: it opens, filters and sorts, and rows open."""

from pathlib import Path
from random import Random

import pytest
from playwright.sync_api import Browser, Page, expect

from scenarios.trials.records import TrialRecord
from scenarios.trials.report.page import write_report
from tests.browser.conftest import Open

CONFIG = {
    "task": "hang",
    "detector": "split",
    "planner": "default",
    "mugs": "test",
    "seed": 0,
    "trials": 1000,
    "commit": "0ff2a45",
}
SEGMENT = {
    "name": "insert",
    "duration_s": 1.5,
    "tracking_error_rad": 0.001,
    "opening_m": 0.02,
    "stopped_by_contact": True,
    "force_n": 5.2,
    "ended_s": 9.0,
}


def records(count: int) -> list[TrialRecord]:
    """Return so many trials, every fourth a failure."""
    random = Random(0)
    found = []
    for index in range(count):
        failed = index % 4 == 3
        attempt = {
            "subgoal": "hang",
            "stage": "grasp" if failed else "success",
            "reason": "the fingers closed on nothing" if failed else "",
            "recovery": "backed out" if failed else "",
            "poses": {"grasp": 200},
            "planning_s": 1.0,
            "segments": [SEGMENT] * 8,
        }
        found.append(
            TrialRecord(
                index=index,
                seed=index,
                mug=f"test_{index % 40:03d}",
                mug_diameter_m=random.uniform(0.06, 0.12),
                outcome="grasp" if failed else "success",
                reason="the fingers closed on nothing" if failed else "",
                attempts=(attempt,),
                seconds={"planning": random.uniform(0.5, 3.0), "execution": 8.0},
            )
        )
    return found


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("few")
    write_report(folder, records(40), CONFIG, 1.0)
    return folder / "index.html"


def shown_keys(page: Page) -> list[str]:
    return page.eval_on_selector_all(
        "tr.row:not([hidden])", "rows => rows.map(row => row.dataset.key)"
    )


def test_a_page_filters_sorts_and_opens(few: Path, opened: Open) -> None:
    page = opened(few)
    expect(page.locator("#count")).to_have_text("40 of 40")
    assert shown_keys(page)[:3] == ["3", "7", "11"], "failures come first"
    page.locator("#failures").check()
    expect(page.locator("#count")).to_have_text("10 of 40")
    page.locator("#failures").uncheck()
    page.locator("select").nth(0).select_option("test_005")
    assert shown_keys(page) == ["5"]
    page.locator("select").nth(0).select_option("")
    page.locator("#words").fill("closed NOTHING test_01")
    assert shown_keys(page) == ["11", "15", "19"]
    page.locator("tr.row:not([hidden])").first.click()
    opened_row = page.locator("tr.open-row")
    expect(opened_row).to_contain_text("attempt 1, hang: grasp: the fingers closed on nothing")
    expect(opened_row).to_contain_text("5.2 N")
    expect(opened_row).to_contain_text("record")
    page.locator("#words").fill("")
    expect(page.locator("#count")).to_have_text("40 of 40")


def test_heads_sort_both_ways(few: Path, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(few.as_uri())
    planning = page.get_by_role("button", name="planning, s")
    planning.click()
    column = "rows => rows.map(row => +row.cells[7].dataset.value)"
    up = page.eval_on_selector_all("tr.row", column)
    assert up == sorted(up)
    planning.click()
    down = page.eval_on_selector_all("tr.row", column)
    assert down == sorted(down, reverse=True)
    page.close()


def test_nothing_is_cut_off_on_a_phone(few: Path, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844})
    page.goto(few.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.close()


def test_a_link_opens_its_row(few: Path, browser: Browser) -> None:
    page = browser.new_page()
    page.goto(few.as_uri() + "#trial-12")
    expect(page.locator("tr.open-row")).to_have_count(1)
    assert (
        page.eval_on_selector("tr.open-row", "row => row.previousElementSibling.id") == "trial-12"
    )
    page.close()


def test_a_thousand_trials_are_filtered_at_once(
    tmp_path: Path, browser: Browser, capsys: pytest.CaptureFixture[str]
) -> None:
    write_report(tmp_path, records(1000), CONFIG, 1.0)
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto((tmp_path / "index.html").as_uri())
    took_ms = page.evaluate(
        """() => {
          const words = document.getElementById("words");
          const times = [];
          for (const text of ["test_01", "closed", "", "test_007 nothing"]) {
            const began = performance.now();
            words.value = text;
            words.dispatchEvent(new Event("input"));
            document.body.offsetHeight;  // laid out anew
            times.push(performance.now() - began);
          }
          return times;
        }"""
    )
    with capsys.disabled():
        print(f"\n1000 trials are filtered in {max(took_ms):.0f} ms at most")
    expect(page.locator("#count")).to_have_text("25 of 1000")
    page.close()
