"""A recording in a browser: it plays, says what happens, and starts where a link says."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import Open
from tests.scenarios.viewing.test_replay_page import recorded

# Drawing without a graphics card takes its time.
_SLOW_MS = 30_000


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recordings"))[0]


def time_s(page: Page) -> float:
    return float(page.evaluate("viewer.animator.time"))


def test_a_recording_plays_and_tells(recording: Path, opened: Open) -> None:
    page = opened(recording)
    expect(page.locator("#told-title")).to_have_text("trial 0 <hang>", timeout=_SLOW_MS)
    expect(page.locator("#told-outcome")).to_have_text("failed: it <slipped>")
    page.wait_for_function("viewer.animator.time > 0.2", timeout=_SLOW_MS)
    expect(page.locator("#told-now")).to_contain_text("s of 3.9", timeout=_SLOW_MS)
    page.evaluate("viewer.animator.pause()")
    assert page.locator("#line span").all_inner_texts()[-4:] == ["transit", "close"] * 2
    page.evaluate("location.hash = '#t=3.5'")
    expect(page.locator("#told-now")).to_contain_text("attempt 2, close, 3.5 s", timeout=_SLOW_MS)
    expect(page.locator("#told-forces")).to_have_text("fingers 18 N and 30 N", timeout=_SLOW_MS)
    page.locator("#play").click()
    assert page.evaluate("viewer.animator.playing")
    page.locator("#legend summary").click()
    expect(page.locator("#legend")).to_contain_text("forces of the fingers")


def test_a_link_says_where_it_starts(recording: Path, browser: Browser) -> None:
    page = browser.new_page()
    page.goto(recording.as_uri() + "#t=2.5")
    page.wait_for_function("viewer.animator.time >= 2.5", timeout=_SLOW_MS)
    expect(page.locator("#told-now")).to_contain_text("attempt 2", timeout=_SLOW_MS)
    assert time_s(page) >= 2.5
    page.close()
