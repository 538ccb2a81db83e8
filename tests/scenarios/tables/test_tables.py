"""Cells, comparisons and what is shown of them."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from scenarios import paper_tables
from scenarios.clutter.records import GraspRecord, Removal, RoundRecord
from scenarios.paper_tables import TableOptions, made_table, names_there, write_table
from scenarios.tables.cells import Cell, cell_folder, keep_cells, read_cell, require_comparable
from scenarios.tables.comparison import compare
from scenarios.tables.markdown import clutter_table, comparison_table, mug_table
from scenarios.tables.mugs import MUG_FIGURES
from scenarios.tables.rows import SCENES, chosen_rows, table_rows
from split_drake.bad_input import BadInputError
from split_drake.experiments.run import json_line
from split_drake.files import UnreadableFileError, write_json

CONFIG = {
    "objects_sha256": "abc",
    "noise": "gaussian",
    "fit_table": False,
    "select": "best",
    "robot": "hand",
    "first_seed": 0,
    "commit": "0ff2a45",
    "processor": "a processor",
}
ROUNDS, SEEDS = 10, 3


def a_round(seed: int, index: int, good: int, bad: int, objects: int = 5) -> RoundRecord:
    """Return a round with so many grasps that succeeded and failed."""
    grasp = GraspRecord(np.eye(4).tolist(), 0.9, 5, ("bar#0",), (), (), "")
    failed = replace(grasp, taken=(), reason="the pads closed on nothing")
    names = tuple(f"bar#{number}" for number in range(objects))
    return RoundRecord(seed, index, names, (grasp,) * good + (failed,) * bad, "no object is left")


def keep(out: Path, name: str, good: float, config: dict[str, object] | None = None) -> None:
    """Write the runs of a row: of five objects, a share `good` is taken on the average."""
    row = next(each for each in table_rows(Path("authors")) if each.name == name)
    for scene in SCENES:
        folder = cell_folder(out, row, scene)
        folder.mkdir(parents=True)
        write_json(folder / "config.json", {**CONFIG, **(config or {})})
        rng = np.random.default_rng(7)  # the same rounds are hard for all
        counts = rng.binomial(5, good, (SEEDS, ROUNDS))
        lines = [
            json_line(a_round(seed, index, int(counts[seed, index]), 5 - int(counts[seed, index])))
            for seed in range(SEEDS)
            for index in range(ROUNDS)
        ]
        (folder / "rounds.jsonl").write_text("\n".join(lines) + "\n")


def options(out: Path, **more: object) -> TableOptions:
    return TableOptions(out, rounds=ROUNDS, seeds=SEEDS, **more)  # type: ignore[arg-type]


def test_rows_are_those_of_the_paper_and_more() -> None:
    names = [row.name for row in table_rows()]
    assert names == ["vgn", "giga", "se3dif", "se3dif_segments", "split_once", "split", "oracle"]
    with_authors = table_rows(Path("somewhere"))
    assert [row.name for row in with_authors if not row.trained_here] == [
        "vgn_authors",
        "giga_authors",
        "oracle",
    ]
    assert with_authors[3].weights["pile"] == Path("somewhere/giga_pile.pt")
    figures = {row.name: row.paper for row in with_authors}
    assert figures["giga_authors"]["pile"].gsr == 56.83
    assert figures["se3dif"]["packed"].dr == 28.35
    assert not figures["se3dif_segments"]


def test_a_table_compares_split_with_all_others(tmp_path: Path) -> None:
    for name, good in (("split", 0.9), ("vgn", 0.6), ("oracle", 0.9)):
        keep(tmp_path, name, good)
    table = made_table(options(tmp_path), table_rows())
    share = table.share(table.rows[0], "packed", "gsr")
    assert share is not None and 0.5 < share.value < 0.7
    worse = table.comparison(table.rows[0], "pile", "dr")
    assert worse is not None and worse.rounds == 30
    assert worse.difference > 0.2 and worse.p < 0.001
    assert worse.interval[0] < worse.difference < worse.interval[1]
    alike = table.comparison(table.rows[-1], "pile", "gsr")
    assert alike is not None and alike.difference == 0.0 and alike.p == 1.0
    assert table.share(table.rows[1], "packed", "gsr") is None


def test_the_bootstrap_pairs_rounds() -> None:
    # The second method takes one object less in every round: no draw of rounds says otherwise.
    row = table_rows()[0]
    cells = []
    for less in (0, 1):
        rounds = [a_round(0, index, 1 + index % 5 - less, 1) for index in range(1, 40, 2)]
        cell = read_of(rounds)
        cells.append(replace(cell, row=row))
    found = compare(cells[0], cells[1], "dr")
    assert found is not None
    assert found.p < 0.001
    assert found.interval == pytest.approx((0.2, 0.2))
    assert compare(cells[0], replace(cells[1], records=()), "dr") is None


def read_of(rounds: list[RoundRecord]) -> Cell:
    return Cell(table_rows()[0], "packed", tuple(rounds), Removal.of(rounds), CONFIG)


def test_only_rounds_that_were_asked_for_count(tmp_path: Path) -> None:
    keep(tmp_path, "split", 0.8)
    row = chosen_rows(("split",), None)[0]
    cell = read_cell(tmp_path, row, "pile", 4, range(1, 3))
    assert cell is not None
    assert [(each.seed, each.index) for each in cell.records] == [
        (seed, index) for seed in (1, 2) for index in range(4)
    ]
    assert read_cell(tmp_path, row, "pile", 4, range(7, 9)) is None
    assert read_cell(tmp_path / "nowhere", row, "pile", 4, range(1)) is None
    failed = replace(a_round(1, 0, 0, 0), ended="it took too long")
    log = cell_folder(tmp_path, row, "pile") / "rounds.jsonl"
    log.write_text(json_line(failed) + "\n" + json_line(a_round(1, 1, 1, 0)) + "\n")
    cell = read_cell(tmp_path, row, "pile", 4, range(1, 3))
    assert cell is not None and len(cell.records) == 1


def test_runs_in_other_conditions_are_no_table(tmp_path: Path) -> None:
    keep(tmp_path, "split", 0.8)
    keep(tmp_path, "vgn", 0.8, {"noise": "dex"})
    with pytest.raises(BadInputError, match="has noise 'gaussian', vgn-packed has 'dex'; a table"):
        made_table(options(tmp_path), table_rows())
    require_comparable([])
    keep(tmp_path / "others", "split", 0.8)
    keep(tmp_path / "others", "oracle", 0.8, {"objects_sha256": "def"})
    physics = {"friction": 0.8, "near_rigid_threshold": 0.1}
    keep(tmp_path / "softer", "split", 0.8, {"physics": {**physics, "near_rigid_threshold": 1.0}})
    keep(tmp_path / "softer", "oracle", 0.8, {"physics": physics})
    told = "oracle-packed has physics {'near_rigid_threshold': 0.1}, split-packed has {'near_rigid"
    with pytest.raises(BadInputError, match=told):
        made_table(options(tmp_path / "softer"), table_rows())
    with pytest.raises(BadInputError, match="oracle-packed has objects_sha256 'def', "):
        made_table(options(tmp_path / "others"), table_rows())
    with pytest.raises(BadInputError, match="holds no runs; --quick or --whole make them"):
        made_table(options(tmp_path / "nowhere"), table_rows())


def test_each_kind_of_scene_may_have_its_objects(tmp_path: Path) -> None:
    keep(tmp_path, "split", 0.8)
    row = chosen_rows(("split",), None)[0]
    write_json(
        cell_folder(tmp_path, row, "pile") / "config.json", {**CONFIG, "objects_sha256": "def"}
    )
    assert made_table(options(tmp_path), [row]).cells
    for scene in SCENES:
        (tmp_path / "objects" / scene).mkdir(parents=True)
    both = options(tmp_path, objects=str(tmp_path / "objects"))
    assert both.clutter(row, "pile").objects == str(tmp_path / "objects" / "pile")
    for part in ("train", "test"):
        (tmp_path / "objects" / "pile" / part).mkdir()
        assert both.clutter(row, "pile").objects == str(tmp_path / "objects" / "pile" / part)
    one = options(tmp_path, objects=str(tmp_path / "objects" / "pile"))
    assert one.clutter(row, "packed").objects == one.objects


def test_cells_are_kept_and_read_again(tmp_path: Path) -> None:
    run, kept = tmp_path / "run", tmp_path / "kept"
    keep(run, "split", 0.8, {"objects": "/home/somebody/objects/packed", "out": "/home/run"})
    keep(run, "vgn", 0.6)
    rows = chosen_rows(("split", "vgn"), None)
    table = made_table(options(run), rows)
    keep_cells(list(table.cells.values()), kept)
    again = made_table(options(tmp_path / "new", kept=kept), rows)
    assert again.to_json() == table.to_json()
    assert not [path for path in kept.rglob("*.json") if "home" in path.read_text()]
    first = {path: path.read_bytes() for path in kept.rglob("*.gz")}
    assert len(first) == 4
    keep_cells(list(again.cells.values()), kept)
    assert {path: path.read_bytes() for path in kept.rglob("*.gz")} == first
    damaged = next(iter(first))
    damaged.write_bytes(first[damaged][:-20])
    with pytest.raises(UnreadableFileError, match="is damaged or not the rounds of a cell"):
        made_table(options(tmp_path / "new", kept=kept), rows)


def test_all_forms_are_written(tmp_path: Path) -> None:
    keep(tmp_path, "split", 0.9)
    keep(tmp_path, "giga_authors", 0.6)
    for figure in MUG_FIGURES[:1]:
        (tmp_path / figure.name).mkdir()
        write_json(tmp_path / figure.name / "config.json", {})
        trial = {"index": 0, "seed": 0, "mug": "test_001", "mug_diameter_m": 0.08}
        line = json.dumps({**trial, "outcome": "success"})
        (tmp_path / figure.name / "trials.jsonl").write_text(line + "\n")
    asked = options(tmp_path, authors=tmp_path)
    table = made_table(replace(asked, rounds=ROUNDS + 1), table_rows(tmp_path))
    write_table(tmp_path, table)
    markdown = (tmp_path / "table.md").read_text()
    for part in (clutter_table(table), comparison_table(table), mug_table(table)):
        assert part in markdown
    assert "; paper 84.0 ± 3.5 |" in markdown and "SPLIT, packed: 30 of 33 rounds" in markdown
    assert "| hang, true poses | 1/1 = 100.0%" in markdown and "31/40" in markdown
    assert "another physics engine" in markdown
    page = (tmp_path / "index.html").read_text()
    assert 'src="table.png"' in page and "paper 84.0 ± 3.5" in page and "points, p " in page
    assert (tmp_path / "table.png").stat().st_size > 10_000
    fields = json.loads((tmp_path / "table.json").read_text())
    assert {row["name"] for row in fields["rows"]} >= {"split", "giga_authors", "se3dif"}
    ours = next(row for row in fields["rows"] if row["name"] == "split")["pile"]
    assert ours["commit"] == "0ff2a45" and 0.8 < ours["ours"]["gsr"] < 1.0


def test_rows_that_cannot_be_run_are_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="--rows has 'dexnet'; expected some of vgn, giga"):
        chosen_rows(("dexnet",), None)
    with pytest.raises(BadInputError, match=r"--rows has 'vgn_authors', but there is no file .*pt"):
        chosen_rows(("vgn_authors",), tmp_path)
    keep(tmp_path, "split", 0.8)
    table = made_table(options(tmp_path), table_rows(tmp_path))
    assert "there is no file" in table.left_out["GIGA, its authors' weights"]


def test_rows_that_ran_are_shown_without_their_weights(tmp_path: Path) -> None:
    keep(tmp_path, "giga_authors", 0.6)
    there = names_there(options(tmp_path / "new", kept=tmp_path))
    assert there == {"giga_authors"}
    (row,) = chosen_rows(("giga_authors",), None, there)
    assert "vgn_authors" not in {each.name for each in table_rows(None, there)}
    table = made_table(options(tmp_path / "new", kept=tmp_path), [row])
    assert table.left_out == {} and "giga_authors-packed" in str(sorted(tmp_path.iterdir()))
    with pytest.raises(BadInputError, match="--rows has 'giga_authors'; expected"):
        chosen_rows(("giga_authors",), None)


def test_missing_rounds_are_run_and_the_table_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[object] = []
    monkeypatch.setattr(paper_tables.clutter_removal, "main", ran.append)
    monkeypatch.setattr(paper_tables.mug_hang, "main", ran.append)
    keep(tmp_path, "split", 0.8)
    asked = TableOptions(tmp_path, quick=True, rows=("split", "oracle"), mug_seed=5)
    paper_tables.main(asked)
    clutter, mugs = ran[:4], ran[4:]
    assert [(each.detector, each.scene) for each in clutter] == [  # type: ignore[attr-defined]
        ("split", "packed"),
        ("split", "pile"),
        ("oracle", "packed"),
        ("oracle", "pile"),
    ]
    assert {(each.rounds, each.seeds) for each in clutter} == {(4, 2)}  # type: ignore[attr-defined]
    assert [(each.task, each.detector, each.trials, each.seed) for each in mugs] == [  # type: ignore[attr-defined]
        ("hang", "oracle", 4, 5),
        ("hang", "split", 4, 5),
        ("reorient", "split", 4, 5),
    ]
    assert (tmp_path / "table.md").is_file()
    with pytest.raises(BadInputError, match="--whole and --quick are both given"):
        TableOptions(tmp_path, quick=True, whole=True)


def test_cells_that_were_kept_whole_are_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[tuple[str, str]] = []
    physics = {"friction": 0.8}
    monkeypatch.setattr(
        paper_tables.clutter_removal,
        "main",
        lambda asked: ran.append((asked.detector, asked.scene)),
    )
    monkeypatch.setattr(
        paper_tables.clutter_removal,
        "run_config",
        lambda asked: {**asdict(asked), "objects_sha256": asked.objects, "physics": physics},
    )
    run, kept = tmp_path / "run", tmp_path / "kept"
    keep(run, "split", 0.8, {"objects_sha256": "procedural", "physics": physics})
    rows = chosen_rows(("split",), None)
    table = made_table(options(run), rows)
    keep_cells(list(table.cells.values()), kept)
    fewer = replace(table.cells["split", "pile"], records=table.cells["split", "pile"].records[1:])
    keep_cells([fewer], kept)
    asked = options(tmp_path / "new", kept=kept, rows=("split",), whole=True, mug_trials=0)
    paper_tables.main(asked)
    assert ran == [("split", "pile")], "it lacks a round"
    keep_cells(list(table.cells.values()), kept)
    ran.clear()
    paper_tables.main(asked)
    assert ran == []
    assert "of other weights than" in capsys.readouterr().out
    paper_tables.main(replace(asked, objects="procedural-train"))
    assert len(ran) == 2, "other objects were asked for"
    ran.clear()
    physics["friction"] = 0.7
    paper_tables.main(asked)
    assert len(ran) == 2, "the physics have changed"
    physics["friction"] = 0.8
    ran.clear()
    with pytest.raises(BadInputError, match="holds no runs"):
        paper_tables.main(replace(asked, first_seed=77))
    assert len(ran) == 2, "other seeds were asked for"
