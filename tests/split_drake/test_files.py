"""Readers name the file that cannot be used, and say why."""

import io
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest

from split_drake.bad_input import BadInputError
from split_drake.files import (
    MissingFileError,
    UnreadableFileError,
    interpreting,
    read_json,
    read_json_object,
    read_npz,
    split_rows,
)

WHAT = "a file of counts"


class Bomb:
    """What makes a folder where it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("exploded",)


def test_arrays_come_back_from_a_path_or_its_text(tmp_path: Path) -> None:
    path = tmp_path / "counts.npz"
    np.savez(path, counts=np.arange(3))
    for given in (path, str(path)):
        assert read_npz(given, WHAT, required=("counts",))["counts"].tolist() == [0, 1, 2]


def test_what_is_missing_is_told_with_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=rf"^there is no file {tmp_path}/no.npz; expected a"):
        read_npz(tmp_path / "no.npz", WHAT)
    with pytest.raises(MissingFileError, match=rf"^there is no file {tmp_path}; expected {WHAT}$"):
        read_json(tmp_path, WHAT)
    np.savez(tmp_path / "counts.npz", b=np.zeros(1), a=np.zeros(1))
    message = rf"counts.npz holds a, b, but no 'counts'; expected {WHAT}$"
    with pytest.raises(UnreadableFileError, match=message):
        read_npz(tmp_path / "counts.npz", WHAT, required=("a", "counts"))


def huge() -> bytes:
    """Return an npz whose only array says that it has 10^15 numbers, and has none."""
    header = io.BytesIO()
    fields = {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
    np.lib.format.write_array_header_1_0(header, fields)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("counts.npy", header.getvalue())
    return archive.getvalue()


def single_array() -> bytes:
    file = io.BytesIO()
    np.save(file, np.zeros(3))
    return file.getvalue()


def pickled_member() -> bytes:
    file = io.BytesIO()
    np.savez(file, counts=np.array([Bomb()], dtype=object))
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [b"", b"PK\x03\x04rubbish", b"text", single_array(), huge(), pickle.dumps(Bomb())],
    ids=["empty", "half a zip", "text", "a single array", "huge", "a pickle"],
)
def test_what_is_no_npz_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "counts.npz"
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError, match=f"^{path} is damaged or not {WHAT}: ."):
        read_npz(path, WHAT)


def test_nothing_is_unpickled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "counts.npz"
    path.write_bytes(pickled_member())
    with pytest.raises(UnreadableFileError, match="Object arrays cannot be loaded"):
        read_npz(path, WHAT)
    assert not (tmp_path / "exploded").exists()


def test_any_damage_is_told_with_the_path(tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.npz", tmp_path / "counts.npz"
    np.savez_compressed(whole, counts=np.arange(50), names=np.array(["a", "b"]))
    rng, content, refused = np.random.default_rng(0), whole.read_bytes(), 0
    for _ in range(300):
        damaged = bytearray(content)
        for at in rng.integers(len(damaged), size=rng.integers(1, 4)):
            damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged[: len(damaged) if rng.random() < 0.7 else rng.integers(400)])
        try:
            read_npz(path, WHAT, required=("counts", "names"))
        except BadInputError as error:
            assert str(error).startswith(str(path))
            refused += 1
    assert refused > 200


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\x00", b"[" * 100_000])
def test_what_is_no_json_is_named(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "counts.json"
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError, match=f"^{path} is damaged or not {WHAT}: ."):
        read_json(path, WHAT)


def test_json_that_is_no_object_is_named(tmp_path: Path) -> None:
    path = tmp_path / "counts.json"
    path.write_text('{"a": 1}')
    assert read_json_object(path, WHAT) == {"a": 1}
    path.write_text("[1, 2]")
    with pytest.raises(UnreadableFileError, match=rf"^{path} holds \[1, 2\], no object; expected"):
        read_json_object(path, WHAT)


def test_content_that_has_no_meaning_is_told_with_the_path() -> None:
    nothing: dict[str, int] = {}
    message = f"^f.npz is damaged or not {WHAT}: 'a' is missing$"
    with pytest.raises(UnreadableFileError, match=message), interpreting("f.npz", WHAT):
        nothing["a"]
    told = "there is no file f.npz"
    with pytest.raises(MissingFileError, match=rf"^{told}$"), interpreting("f.npz", WHAT):
        raise MissingFileError(told)
    with (
        pytest.raises(UnreadableFileError, match=r"^f\.npz: a is -1$"),
        interpreting("f.npz", WHAT),
    ):
        raise BadInputError("a is -1")


def test_rows_are_split_where_their_counts_fit() -> None:
    pieces = split_rows(np.arange(5), np.array([2, 0, 3]), "rows")
    assert [piece.tolist() for piece in pieces] == [[0, 1], [], [2, 3, 4]]
    assert split_rows(np.zeros(0), np.zeros(0, dtype=int), "rows") == []
    with pytest.raises(ValueError, match=r"rows has shape \(5,\); its counts say 6 rows"):
        split_rows(np.arange(5), np.array([6]), "rows")
    with pytest.raises(ValueError, match="expected whole numbers"):
        split_rows(np.arange(5), np.array([6, -1]), "rows")
