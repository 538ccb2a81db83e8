"""Parts of runs, made one."""

from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from scenarios.clutter.records import clutter_run
from scenarios.clutter_removal import ClutterOptions, missing_rounds
from scenarios.merge import MergeOptions, merge
from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.records import TrialRecord, trial_run
from split_drake.bad_input import BadInputError
from split_drake.experiments.run import AnotherRunError, json_line
from split_drake.experiments.shards import Shard
from split_drake.files import read_json_object, write_json
from tests.scenarios.tables.test_tables import a_round

CONFIG = {
    "task": "hang",
    "detector": "oracle",
    "planner": "default",
    "mugs": "test",
    "seed": 0,
    "trials": 7,
    "commit": "abc",
}
QUIET = Console(quiet=True)


def part(folder: Path, shard: str | None, indices: list[int], **options: object) -> Path:
    """Write a part of a run of seven trials."""
    folder.mkdir()
    config = {**CONFIG, "shard": shard, "out": str(folder), "workers": 3, **options}
    write_json(folder / "config.json", config)
    good = TrialRecord(0, 0, "test_000", 0.08, "success")
    for index in indices:
        name = f"recordings/{index:03d}.html"
        (folder / "recordings").mkdir(exist_ok=True)
        (folder / name).write_text(f"{index}")
        record = replace(good, index=index, seed=index, recording=name)
        with (folder / "trials.jsonl").open("a") as log:
            log.write(json_line(record) + "\n")
    return folder


def test_parts_share_all_items_and_none_twice() -> None:
    parts = [Shard.parse(f"{number}/3") for number in (1, 2, 3)]
    for index in range(20):
        assert sum(each.takes(index) for each in parts) == 1
    for text in ("0/3", "4/3", "1", "a/b", "1/0", "-1/2", "1/2/3"):
        with pytest.raises(BadInputError, match=r"--shard is .*; expected such as 2/5"):
            Shard.parse(text)


def test_runs_make_the_items_of_their_part(tmp_path: Path) -> None:
    whole = MugHangOptions(trials=7, detector="oracle")
    made = [specs_of(replace(whole, shard=f"{n}/2"), tmp_path, ()) for n in (1, 2)]
    assert [[spec.index for spec in specs] for specs in made] == [[0, 2, 4, 6], [1, 3, 5]]
    clutter = ClutterOptions("packed", 3, 2, 10, "oracle")
    parts = [missing_rounds(replace(clutter, shard=f"{n}/2"), tmp_path, ()) for n in (1, 2)]
    keys = [[(spec.seed, spec.index) for spec in specs] for specs in parts]
    assert keys == [[(10, 0), (10, 2), (11, 1)], [(10, 1), (11, 0), (11, 2)]]


def test_parts_become_one_run(tmp_path: Path) -> None:
    second = part(tmp_path / "b", "2/2", [1, 3, 5], commit="abc-dirty", workers=1)
    first = part(tmp_path / "a", "1/2", [0, 2, 4, 6])
    out = tmp_path / "whole"
    merge(MergeOptions((second, first), out), QUIET)
    assert [record.index for record in trial_run(out).records()] == list(range(7))
    config = read_json_object(out / "config.json", "")
    assert config["shard"] is None and config["trials"] == 7
    assert read_json_object(out / "summary.json", "")["successes"] == 7
    assert (out / "recordings" / "005.html").read_text() == "5"
    assert "7/7" in (out / "index.html").read_text()
    with pytest.raises(AnotherRunError, match="holds"):
        merge(MergeOptions((first, second), second), QUIET)


def test_rounds_become_one_run(tmp_path: Path) -> None:
    config = {
        "scene": "pile",
        "robot": "hand",
        "detector": "oracle",
        "noise": "none",
        "objects": "procedural",
        "fit_table": False,
        "select": "best",
        "seeds": 2,
        "first_seed": 4,
        "rounds": 2,
    }
    folders = []
    for number, keys in ((1, [(4, 0), (5, 0)]), (2, [(4, 1), (5, 1)])):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_json(folder / "config.json", {**config, "shard": f"{number}/2"})
        lines = [json_line(a_round(seed, index, 3, 1)) for seed, index in keys]
        (folder / "rounds.jsonl").write_text("\n".join(lines) + "\n")
        folders.append(folder)
    merge(MergeOptions(tuple(folders), tmp_path / "whole"), QUIET)
    found = [(each.seed, each.index) for each in clutter_run(tmp_path / "whole").records()]
    assert found == [(4, 0), (4, 1), (5, 0), (5, 1)]


def test_what_is_no_part_of_the_run_is_refused(tmp_path: Path) -> None:
    first = part(tmp_path / "a", "1/2", [0, 2, 4, 6])
    second = part(tmp_path / "b", "2/2", [1, 3, 5])
    foreign = part(tmp_path / "c", "2/2", [1, 3, 5], planner="rrt")
    overlapping = part(tmp_path / "d", "2/2", [1, 2, 3])
    of_three = part(tmp_path / "e", "2/3", [1, 4])
    whole = part(tmp_path / "f", None, [0])
    out = tmp_path / "out"
    for runs, says in (
        ((first,), r"parts are missing: 2/2"),
        ((first, foreign), r"planner was 'default', is 'rrt'"),
        ((first, overlapping), r"d is part 2/2, but holds item 2 of another part"),
        ((first, of_three), r"e is part 2/3, .*a 1/2"),
        ((first, whole), r"f is no part of a run"),
        ((first, tmp_path / "nowhere"), r"has no config.json"),
    ):
        with pytest.raises(BadInputError, match=says):
            merge(MergeOptions(runs, out), QUIET)
    copied = part(tmp_path / "g", "2/2", [1, 3, 5])
    with pytest.raises(BadInputError, match=r"g and .*b are both part 2/2"):
        merge(MergeOptions((first, second, copied), out), QUIET)
    assert not out.exists()
