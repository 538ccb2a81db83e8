"""What a run of clutter removal shows: its page, and recordings of its rounds."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.clutter.records import EMPTIED, TWO_FAILURES, GraspRecord, RoundRecord
from scenarios.clutter.report import index_page, write_report
from scenarios.clutter.rounds import RoundSpec, run_round
from scenarios.clutter_removal import ClutterOptions, missing_rounds
from scenarios.viewing.page import link, table_page, text
from split_drake.poses import make_pose

CONFIG = {
    "scene": "pile",
    "detector": "split",
    "noise": "dex",
    "fit_table": True,
    "select": "best",
    "seeds": 1,
    "objects": "procedural",
}


def grasp(taken: tuple[str, ...] = (), reason: str = "") -> GraspRecord:
    pose = make_pose(p=np.zeros(3)).tolist()
    return GraspRecord(pose, 0.73, 9, taken, ("ball#3",), (), reason)


def rounds() -> list[RoundRecord]:
    empty = "the hand holds <nothing>"
    return [
        RoundRecord(4, 0, ("can#0",), (grasp(("can#0",)),), EMPTIED),
        RoundRecord(
            4,
            1,
            ("bar#0", "cup#1"),
            (grasp(reason=empty), grasp(reason=empty)),
            TWO_FAILURES,
            recording="recordings/004-001.html",
        ),
    ]


def test_the_page_lists_each_grasp_and_why_it_failed() -> None:
    page = index_page(rounds(), "a <title>")
    assert "a &lt;title&gt;" in page
    assert '0.73 <span class="ok">can#0</span> (lost: ball#3)' in page
    assert page.count('0.73 <span class="failed">the hand holds &lt;nothing&gt;</span>') == 2
    assert page.count('<a href="recordings/004-001.html">replay</a>') == page.count("replay") == 1
    assert '<span class="failed">0/2</span>' in page
    assert "grasps that succeeded (GSR): 33.3%" in page
    assert f"rounds ended: 1: {EMPTIED}; 1: {TWO_FAILURES}" in page


def test_the_report_is_written_beside_the_log(tmp_path: Path) -> None:
    write_report(tmp_path, rounds(), CONFIG)
    assert "pile, split, noise dex, objects procedural" in (tmp_path / "index.html").read_text()
    assert '"fit_table": true' in (tmp_path / "summary.json").read_text()


def test_cells_are_escaped_and_absent_links_are_empty() -> None:
    assert text("<b>") == "&lt;b&gt;"
    assert link(None, "replay") == ""
    page = table_page("t", ["a & b"], ["<h>"], [[text("<c>")]])
    assert "<li>a &amp; b</li>" in page and "<th>&lt;h&gt;</th>" in page
    assert "width=device-width" in page, "phones show it at their own width"


def spec_of(folder: Path, **options: Any) -> RoundSpec:
    asked = ClutterOptions(
        "packed", 1, 1, 7, "oracle", objects="procedural-train", noise="none", **options
    )
    return missing_rounds(asked, folder, ())[0]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RoundRecord]:
    folder = tmp_path_factory.mktemp("recorded")
    return folder, run_round(spec_of(folder, record="all"))


def test_a_recording_is_a_page_with_grasps(recorded: tuple[Path, RoundRecord]) -> None:
    folder, record = recorded
    assert record.recording == "recordings/007-000.html"
    page = (folder / record.recording).read_text()
    assert len(page) > 500_000
    assert "meshcat" in page.lower()


def test_outcomes_do_not_depend_on_recording(
    recorded: tuple[Path, RoundRecord], tmp_path: Path
) -> None:
    _, record = recorded
    alone = run_round(spec_of(tmp_path, record="none"))
    assert alone.recording is None
    assert not (tmp_path / "recordings").exists()
    assert replace(alone, wall_s=0.0) == replace(record, wall_s=0.0, recording=None)


def test_of_rounds_without_failures_none_is_kept(tmp_path: Path) -> None:
    record = run_round(spec_of(tmp_path))
    wanted = not (record.clean and record.ended == EMPTIED)
    assert (record.recording is not None) == wanted == (tmp_path / "recordings").exists()
