"""What a run was made with."""

from pathlib import Path

import pytest

from split_drake.experiments import provenance
from split_drake.experiments.provenance import UNKNOWN_COMMIT, code_sha256, code_version
from split_drake.experiments.run import claim_folder


def test_another_edit_of_the_code_is_another_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, run = tmp_path / "tree", tmp_path / "run"
    module = root / "planning" / "mine.py"
    module.parent.mkdir(parents=True)
    module.write_text("TRIES = 1\n")
    monkeypatch.setattr(provenance, "_ROOT", root)
    claim_folder(run, code_version(), ())
    claim_folder(run, code_version(), ())
    module.write_text("TRIES = 2\n")
    with pytest.raises(ValueError, match=r"holds another run.*code_sha256 was"):
        claim_folder(run, code_version(), ())


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
