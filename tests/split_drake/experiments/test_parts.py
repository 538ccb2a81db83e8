"""Parts of a file: they stay where making it was interrupted, and go when it is made."""

from pathlib import Path

import pytest

from split_drake.experiments.parts import parts_of
from split_drake.experiments.run import AnotherRunError

CONFIG = {"objects": "train"}


def interrupted(file: Path, error: type[BaseException]) -> None:
    with parts_of(file, CONFIG) as parts:
        parts.path(1).write_bytes(b"made")
        raise error


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_what_was_made_before_an_interruption_is_not_missing(
    tmp_path: Path, error: type[BaseException]
) -> None:
    file = tmp_path / "whole.npz"
    with pytest.raises((RuntimeError, SystemExit)):
        interrupted(file, error)
    with parts_of(file, CONFIG) as parts:
        assert parts.missing(3) == [0, 2]
        assert parts.path(1).read_bytes() == b"made"
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_is_told_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"goes on from .*whole\.npz\.parts"):
        interrupted(tmp_path / "whole.npz", KeyboardInterrupt)


def test_parts_of_something_else_are_no_parts(tmp_path: Path) -> None:
    file = tmp_path / "whole.npz"
    with pytest.raises(RuntimeError):
        interrupted(file, RuntimeError)
    other = parts_of(file, {"objects": "test"})
    with pytest.raises(AnotherRunError, match="objects was 'train', is 'test'"), other:
        pass
    with parts_of(file, {"objects": "train", "workers": 2}, ("workers",)) as parts:
        assert parts.missing(2) == [0]
