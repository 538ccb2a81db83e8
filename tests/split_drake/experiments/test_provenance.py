"""What a run was made with."""

import json
from functools import partial
from pathlib import Path

import pytest

from split_drake.experiments import provenance
from split_drake.experiments.provenance import (
    UNKNOWN_COMMIT,
    code_sha256,
    code_version,
    file_sha256,
    processor,
    qualified_name,
)
from split_drake.experiments.run import CONFIG, claim_folder


def test_another_edit_of_the_code_is_another_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, run = tmp_path / "tree", tmp_path / "run"
    module = root / "planning" / "mine.py"
    module.parent.mkdir(parents=True)
    module.write_text("TRIES = 1\n")
    monkeypatch.setattr(provenance, "_ROOT", root)
    for _ in range(2):
        with claim_folder(run, code_version()):
            pass
    module.write_text("TRIES = 2\n")
    with (
        pytest.raises(ValueError, match=r"holds another run.*code_sha256 was"),
        claim_folder(run, code_version()),
    ):
        pass


def test_another_commit_of_the_same_code_is_the_same_run(tmp_path: Path) -> None:
    before = code_version()
    with claim_folder(tmp_path, before):
        pass
    after = before | {"commit": "0123456789"}
    with claim_folder(tmp_path, after):
        pass
    assert json.loads((tmp_path / CONFIG).read_text())["commit"] == "0123456789"


def test_a_readme_is_no_part_of_the_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    found = [code_sha256()]
    for name in ("README.md", "planning/README.md", "models/hand.obj"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("other")
        found.append(code_sha256())
    assert found[0] == found[1] == found[2] != found[3]


def test_regions_are_part_of_the_code_and_problems_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    found = [code_sha256()]
    for name in ("problems", "regions"):
        path = tmp_path / "models" / name / "some.npz"
        path.parent.mkdir(parents=True)
        path.write_bytes(b"other")
        found.append(code_sha256())
    assert found[0] == found[1] != found[2]


def test_code_that_is_no_checkout_has_no_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provenance, "_ROOT", tmp_path)
    found = code_version()
    assert found["commit"] == UNKNOWN_COMMIT
    assert len(found["code_sha256"]) == 64
    assert {"python", "drake"} <= set(found["versions"])


class Called:
    """What is called like a function."""

    def __call__(self) -> None: ...


def test_functions_are_named_by_where_they_are_defined() -> None:
    assert qualified_name(file_sha256) == "split_drake.experiments.provenance.file_sha256"
    assert qualified_name(partial(partial(file_sha256), Path("x"))) == qualified_name(file_sha256)
    assert qualified_name(Called()).endswith("test_provenance.Called")


def test_the_processor_is_named_with_its_widest_vectors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text(
        "model name\t: Some CPU\nflags\t\t: sse4_1 avx2\n\nmodel name\t: Other\nflags\t: avx512f\n"
    )
    monkeypatch.setattr(provenance, "_CPUINFO", cpuinfo)
    assert processor() == "Some CPU, AVX2"
    monkeypatch.setattr(provenance, "_CPUINFO", tmp_path / "none")
    assert processor()
