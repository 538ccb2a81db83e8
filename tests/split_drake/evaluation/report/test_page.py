"""The page of an evaluation."""

from dataclasses import replace

from split_drake.evaluation.record import SceneRecord, Scored, TaskRecord
from split_drake.evaluation.report.page import page_of
from split_drake.experiments.pages.render import render
from split_drake.pose_task import GRASP, HANDLE

QUESTION = {"noise_m": 0.005, "seed": 0, "mugs": "test", "detector": {"commit": "0ff2a45"}}


def a_scene(index: int, grasp: bool, handle: bool | None) -> SceneRecord:
    """Return a scene whose top-ranked samples are good or not; None where that is not judged."""
    samples = Scored((0.9, 0.1), "10")
    parts = {
        GRASP.name: TaskRecord({"top_good": grasp}, {}, {"samples_good": (1, 2)}, samples),
        HANDLE.name: TaskRecord(
            {} if handle is None else {"top_good": handle, "peg_clear": handle},
            {"position_mm": 2.40579},
            {},
            samples,
        ),
    }
    return SceneRecord(index, f"test_{index % 2:03d}", 100, 0.512, parts)


RECORDS = [a_scene(0, True, True), a_scene(1, False, True), a_scene(2, True, None)]


def test_scenes_that_failed_come_first() -> None:
    page = page_of(RECORDS, (GRASP, HANDLE), QUESTION, ("errors.png",))
    assert [(row.key, row.good) for row in page.rows] == [("1", False), ("0", True), ("2", True)]
    failed, _, unjudged = page.rows
    assert [cell.value for cell in failed.cells[:5]] == [1, "test_001", "shows", "not good", "good"]
    assert unjudged.cells[4].value == "not judged" and unjudged.cells[4].good is None
    assert failed.cells[5].value == 50.0 and failed.cells[6].value is None
    assert failed.record["tasks"]["handle"]["values"] == {"position_mm": 2.406}
    assert {bar.name: bar.shown for bar in page.bars}["grasp: top good"].startswith("2/3")
    assert ("noise", "5 mm on the points") in page.facts
    text = render(page)
    assert "test_001" in text and '<img src="errors.png"' in text and "samples" not in failed.record


def test_where_nothing_fails_no_object_is_the_worst() -> None:
    good = [replace(record) for record in RECORDS if record.index != 1]
    assert len(page_of(good, (GRASP, HANDLE), QUESTION, ()).plots) == 0
    assert len(page_of(RECORDS, (GRASP, HANDLE), QUESTION, ()).plots) == 1
