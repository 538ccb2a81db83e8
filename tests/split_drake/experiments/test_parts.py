"""Parts of a file: they stay where making it was interrupted, and go when it is made."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from split_drake.experiments.parts import parts_of
from split_drake.experiments.provenance import code_sha256
from split_drake.experiments.run import AnotherRunError
from split_drake.models_folder import MODELS_FOLDER

CONFIG = {"objects": "train"}
ITEMS = ("a", "b", "c")


def make(file: Path, config: dict[str, str], error: BaseException | None = None) -> list[str]:
    """Make the parts that are missing; return those, or raise the error after the first one."""
    made: list[str] = []

    with parts_of(file, config) as parts:

        def work(items: list[str]) -> Iterator[str]:
            for item in items:
                yield item
                if error is not None:
                    raise error

        def save(item: str) -> None:
            made.append(item)
            parts.path(ITEMS.index(item)).write_text(item)

        parts.make(ITEMS, work, save, "parts")
        whole = "".join(parts.path(number).read_text() for number in range(len(ITEMS)))
        file.write_text(whole)
    return made


@pytest.mark.parametrize("error", [RuntimeError(), KeyboardInterrupt()])
def test_what_was_made_before_an_interruption_is_not_made_again(
    tmp_path: Path, error: BaseException
) -> None:
    file = tmp_path / "whole.npz"
    with pytest.raises((RuntimeError, SystemExit)):
        make(file, CONFIG, error)
    assert not file.exists()
    assert make(file, CONFIG) == ["b", "c"]
    assert file.read_text() == "abc"
    assert list(tmp_path.iterdir()) == [file]
    assert make(file, CONFIG) == list(ITEMS), "a file that is there is made anew"


def test_an_interruption_is_told_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"goes on from .*whole\.npz\.parts"):
        make(tmp_path / "whole.npz", CONFIG, KeyboardInterrupt())


def test_parts_of_something_else_are_refused_with_a_way_out(tmp_path: Path) -> None:
    file = tmp_path / "whole.npz"
    with pytest.raises(RuntimeError):
        make(file, CONFIG, RuntimeError())
    with pytest.raises(
        AnotherRunError, match=r"whole\.npz\.parts .*objects was 'train', is 'test'.*remove it"
    ):
        make(file, {"objects": "test"})


def test_parts_stay_for_another_try_where_they_are_told_to(tmp_path: Path) -> None:
    file = tmp_path / "whole.npz"
    with parts_of(file, CONFIG) as parts:
        parts.path(1).write_text("b")
        parts.stay = True
    assert make(file, CONFIG) == ["a", "c"]


def test_parts_beside_models_are_no_code() -> None:
    before = code_sha256()
    file = MODELS_FOLDER / "mugs" / "of_a_test.npz"
    with parts_of(file, CONFIG) as parts:
        parts.path(0).write_bytes(b"made")
        assert code_sha256() == before
    assert not file.with_name("of_a_test.npz.parts").exists()
