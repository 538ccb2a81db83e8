"""Values that travel with the files that they name."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from split_drake.bad_input import BadInputError
from split_drake.experiments.cluster import travel
from split_drake.experiments.cluster.plugin import Code
from split_drake.experiments.cluster.travel import Freight, pack, unpack, write_files


@dataclass(frozen=True)
class Named:
    path: Path
    text: str = ""


def test_paths_become_those_of_copies(tmp_path: Path) -> None:
    run, there = tmp_path / "run", tmp_path / "there"
    run.mkdir()
    weights = tmp_path / "weights.bin"
    weights.write_bytes(b"abc")
    nowhere = tmp_path / "nowhere"
    freight = Freight()
    value = [Named(weights, "x"), Named(run), Named(run / "new" / "file"), Named(nowhere), weights]
    content = pack(value, run, freight)
    write_files(there, freight.contents())
    copy, folder, file, same, again = unpack(content, tmp_path / "other", there)
    assert copy.text == "x" and copy.path != weights and copy.path.name == "weights.bin"
    assert copy.path.read_bytes() == b"abc" and again == copy.path
    assert folder.path == tmp_path / "other" and file.path == tmp_path / "other" / "new" / "file"
    assert same.path == nowhere
    assert len(freight.files) == 1


def test_the_same_content_travels_once(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name / "mugs").mkdir(parents=True)
        (tmp_path / name / "mugs" / "cup.obj").write_text("v 0 0 0")
    freight = Freight()
    first, second = (freight.add(tmp_path / name / "mugs") for name in ("a", "b"))
    assert first == second and first.endswith("/mugs")
    (tmp_path / "a" / "mugs" / "new.obj").write_text("v 0 0 1")
    later = Freight()
    assert later.add(tmp_path / "a" / "mugs") != first


def test_what_lies_behind_links_travels_too(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "b.obj").write_text("v 0 0 0")
    (tmp_path / "objects").mkdir()
    (tmp_path / "objects" / "linked").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "objects" / "back").symlink_to(tmp_path / "objects")
    freight = Freight()
    place = freight.add(tmp_path / "objects")
    assert sorted(freight.files) == [f"{place}/linked/b.obj"]
    assert freight.add(tmp_path / "objects" / ".." / "objects") == place


def test_a_users_file_in_the_runs_folder_is_sent(tmp_path: Path) -> None:
    run, there = tmp_path / "run", tmp_path / "there"
    (run / "kept").mkdir(parents=True)
    for name in ("weights.bin", "kept/cache.bin"):
        (run / name).write_text(name)
    freight = Freight()
    content = pack([run / "weights.bin", run / "kept" / "cache.bin"], run, freight, ("kept",))
    write_files(there, freight.contents())
    weights, cache = unpack(content, tmp_path / "other", there)
    assert weights.read_text() == "weights.bin" and weights.is_relative_to(there)
    assert cache == tmp_path / "other" / "kept" / "cache.bin"


def test_data_sets_do_not_travel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "data.bin").write_bytes(b"x" * 2000)
    monkeypatch.setattr(travel, "MOST_BYTES", 1000)
    with pytest.raises(BadInputError, match=r"data.bin makes 0.0 GB to send to each worker"):
        pack(tmp_path / "data.bin", None, Freight())


def test_files_stay_within_their_folder(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"'\.\./evil' is no place within"):
        write_files(tmp_path / "run", {"../evil": b""})
    assert not (tmp_path / "evil").exists()


def test_other_code_is_told() -> None:
    ours = Code("a" * 64, "b" * 64, {"drake": "1.51.1", "torch": "2.12"})
    assert ours.difference(ours) == ""
    assert ours.difference(Code("a" * 64, "b" * 64, {"drake": "1.50", "torch": "2.12"})) == (
        "drake 1.50, expected 1.51.1"
    )
    assert ours.difference(Code("a" * 64, "c" * 64, {})).startswith("weights cccccccccccc, exp")
