"""What a run of clutter removal shows: its page, and recordings of its rounds."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scenarios.clutter.detection import ranked
from scenarios.clutter.detectors import oracle
from scenarios.clutter.page import page_of
from scenarios.clutter.records import EMPTIED, NO_PLAN, TWO_FAILURES, GraspRecord, RoundRecord
from scenarios.clutter.report import write_report
from scenarios.clutter.rounds import run_round
from scenarios.clutter.spec import RoundSpec
from scenarios.clutter_removal import ClutterOptions, missing_rounds
from scenarios.viewing.page import link, table_page, text
from scenarios.viewing.recording import Recorder
from split_drake.experiments.pages.render import render
from split_drake.pose_task import GRASP
from split_drake.poses import make_pose, rotation_x

CONFIG = {
    "scene": "pile",
    "detector": "split",
    "robot": "arm",
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
    page = page_of(rounds(), CONFIG, "a <title>")
    assert [row.key for row in page.rows] == ["4-1", "4-0"], "failures come first"
    failed, good = page.rows
    assert [track.outcome for track in good.tracks] == ["took can#0"]
    assert ("pushed off the table", "ball#3") in good.tracks[0].facts
    assert [track.outcome for track in failed.tracks] == ["the hand holds <nothing>"] * 2
    assert [link.target for link in failed.links] == ["recordings/004-001.html"]
    assert page.bars[0].shown.startswith("33.3%")
    shown = render(page)
    assert "a &lt;title&gt;" in shown
    assert shown.count('<a href="recordings/004-001.html">replay</a>') == 1
    assert "<nothing>" not in shown


def test_the_page_says_what_kept_grasps_from_being_planned() -> None:
    unplanned = RoundRecord(4, 2, ("can#0",), (), NO_PLAN, "rejected by: <IK> 12")
    shown = render(page_of([unplanned], CONFIG, "title"))
    assert NO_PLAN in shown and "rejected by: &lt;IK&gt; 12" in shown


def test_the_report_is_written_beside_the_log(tmp_path: Path) -> None:
    write_report(tmp_path, rounds(), CONFIG)
    assert (
        "pile, arm, split, noise dex, objects procedural" in (tmp_path / "index.html").read_text()
    )
    assert '"fit_table": true' in (tmp_path / "summary.json").read_text()


def test_cells_are_escaped_and_absent_links_are_empty() -> None:
    assert text("<b>") == "&lt;b&gt;"
    assert link(None, "replay") == ""
    page = table_page("t", ["a & b"], ["<h>"], [[text("<c>")]])
    assert "<li>a &amp; b</li>" in page and "<th>&lt;h&gt;</th>" in page
    assert "width=device-width" in page, "phones show it at their own width"


def spec_of(folder: Path, **options: Any) -> RoundSpec:
    asked = ClutterOptions(
        "packed", 1, 1, 48, "oracle", objects="procedural-train", noise="none", **options
    )
    return missing_rounds(asked, folder, ())[0]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RoundRecord]:
    folder = tmp_path_factory.mktemp("recorded")
    return folder, run_round(spec_of(folder, record="all"))


def test_a_recording_is_a_page_with_grasps(recorded: tuple[Path, RoundRecord]) -> None:
    folder, record = recorded
    assert record.recording == "recordings/048-000.html"
    page = (folder / record.recording).read_text()
    assert len(page) > 100_000
    assert "round 48-0, packed, oracle" in page and "grasp 1" in page
    assert list((folder / "recordings").glob("meshcat-*.js"))


def test_outcomes_do_not_depend_on_recording(
    recorded: tuple[Path, RoundRecord], tmp_path: Path
) -> None:
    _, record = recorded
    alone = run_round(spec_of(tmp_path, record="none"))
    assert alone.recording is None
    assert not (tmp_path / "recordings").exists()
    assert replace(alone, wall_s=0.0) == replace(record, wall_s=0.0, recording=None)


def test_of_rounds_with_failures_one_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_the_air = ranked(make_pose(rotation_x(np.pi), (0.5, 0.0, 0.3))[None], [0.5])
    finds = SimpleNamespace(detect=lambda scene, rng: in_the_air)
    monkeypatch.setattr(oracle, "TrueGrasps", lambda clearing, rng: finds)
    record = run_round(spec_of(tmp_path))
    assert record.ended == TWO_FAILURES
    assert record.recording == "recordings/048-000.html"
    assert (tmp_path / record.recording).is_file()


def test_the_chosen_grasp_is_drawn_over_those_found() -> None:
    recorder, X_WG = Recorder(), make_pose(rotation_x(np.pi), (0.5, 0.0, 0.1))
    recorder.start(0.0)
    recorder.show_perception(np.zeros((1, 3)), {GRASP.name: ranked(X_WG[None], [0.9])}, 0.0)
    recorder.show_grasp(X_WG)
    seen = "/perception/1/seen"
    found, chosen = f"{seen}/{GRASP.name}/band_0", f"{seen}/chosen"
    assert recorder.meshcat.HasPath(found) and recorder.meshcat.HasPath(chosen)
    thin, thick = (len(recorder.meshcat._GetPackedObject(path)) for path in (found, chosen))
    # Six copies of four segments of float32 are 576 bytes; the names of the paths differ too.
    assert thick - thin > 500


def test_of_rounds_without_failures_none_is_kept(tmp_path: Path) -> None:
    record = run_round(spec_of(tmp_path))
    wanted = not (record.clean and record.ended == EMPTIED)
    assert (record.recording is not None) == wanted == (tmp_path / "recordings").exists()


COLLECTED_ELSEWHERE = """
import gc, sys, threading
from pathlib import Path
from scenarios.clutter.rounds import run_round
from scenarios.clutter_removal import ClutterOptions, missing_rounds

gc.disable()
asked = ClutterOptions(
    "packed", 1, 1, 48, "oracle", objects="procedural-train", noise="none", record="all"
)
run_round(missing_rounds(asked, Path(sys.argv[1]), ())[0])
collector = threading.Thread(target=gc.collect)
collector.start()
collector.join()
"""


def test_a_recorder_is_freed_in_the_thread_that_made_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", COLLECTED_ELSEWHERE, str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
