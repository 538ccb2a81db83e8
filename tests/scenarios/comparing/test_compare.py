"""Two runs on the same scenes."""

from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.clutter.records import EMPTIED, TWO_FAILURES, RoundRecord
from scenarios.compare import CompareOptions, compared, main
from scenarios.trials.records import TrialRecord
from split_drake.bad_input import BadInputError
from split_drake.experiments.run import json_line
from split_drake.files import write_json
from tests.scenarios.tables.test_tables import a_round

CONFIG = {"task": "hang", "mugs": "test", "objects": 0, "planner": "default", "out": "a"}


def keep_trials(folder: Path, failed: set[int], **options: object) -> Path:
    """Write a run of ten trials, those of seeds that `failed` failures."""
    folder.mkdir()
    write_json(folder / "config.json", {**CONFIG, **options})
    good = TrialRecord(0, 0, "test_000", 0.08, "success", recording="recordings/000.html")
    bad = replace(good, outcome="grasp", reason="it <slipped>")
    lines = [
        json_line(replace(bad if seed in failed else good, index=seed, seed=seed))
        for seed in range(10)
    ]
    (folder / "trials.jsonl").write_text("\n".join(lines) + "\n")
    return folder


def test_trials_are_paired_by_their_seeds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = keep_trials(tmp_path / "a", {1, 2, 3, 4, 5, 6, 7})
    second = keep_trials(tmp_path / "b", {1, 9}, planner="rrt", out="b")
    options = CompareOptions((first, second), tmp_path / "pages" / "c.html")
    page = compared(options)
    assert [bar.shown.partition(" ")[0] for bar in page.bars] == ["3/10", "8/10"]
    facts = dict(page.facts)
    assert "1 succeed in the first alone, 6 in the second alone" in facts["difference"]
    assert "p 0.125" in facts["difference"]
    assert facts["planner"] == "default → rrt" and "out" not in facts
    changes = [row.cells[2].value for row in page.rows]
    assert changes == ["worse"] + ["better"] * 6 + ["same"] * 3
    assert page.rows[0].key == "9"
    assert page.rows[0].links[1].target == "../b/recordings/000.html"
    main(options)
    assert "it &lt;slipped&gt;" in options.out.read_text()
    assert "McNemar" in capsys.readouterr().out


def keep_rounds(folder: Path, rounds: list[RoundRecord]) -> Path:
    folder.mkdir()
    write_json(folder / "config.json", {"scene": "pile", "objects_sha256": "x", "robot": "hand"})
    (folder / "rounds.jsonl").write_text("".join(json_line(each) + "\n" for each in rounds))
    return folder


def test_rounds_are_paired_by_seed_and_number(tmp_path: Path) -> None:
    good = [replace(a_round(0, index, 5, 0), ended=EMPTIED) for index in range(12)]
    bad = [replace(a_round(0, index, 2, 2), ended=TWO_FAILURES) for index in range(11)]
    folders = keep_rounds(tmp_path / "a", bad), keep_rounds(tmp_path / "b", good)
    page = compared(CompareOptions(folders, tmp_path / "c.html"))
    assert [bar.shown for bar in page.bars] == ["50.0%", "100.0%", "40.0%", "100.0%"]
    assert "+50.0 points" in dict(page.facts)["grasps that succeed (GSR)"]
    assert dict(page.facts)["rounds that both have"] == "11"
    assert {row.cells[2].value for row in page.rows} == {"better"}


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    first = keep_trials(tmp_path / "a", set())
    other = keep_trials(tmp_path / "b", set(), mugs="thin")
    with pytest.raises(BadInputError, match=r"has mugs 'test', .* has mugs? 'thin'|has 'thin'"):
        compared(CompareOptions((first, other), tmp_path / "c.html"))
    rounds = keep_rounds(tmp_path / "r", [a_round(0, 0, 1, 0)])
    with pytest.raises(BadInputError, match="are of different kinds"):
        compared(CompareOptions((first, rounds), tmp_path / "c.html"))
    with pytest.raises(BadInputError, match=r"has no config.json; expected the folder of a run"):
        compared(CompareOptions((first, tmp_path / "nowhere"), tmp_path / "c.html"))
    later = keep_rounds(tmp_path / "s", [a_round(7, 0, 1, 0)])
    with pytest.raises(BadInputError, match="have no scene in common"):
        compared(CompareOptions((rounds, later), tmp_path / "c.html"))
    empty = tmp_path / "e"
    empty.mkdir()
    write_json(empty / "config.json", {})
    with pytest.raises(BadInputError, match=r"neither trials.jsonl nor rounds.jsonl"):
        compared(CompareOptions((first, empty), tmp_path / "c.html"))
