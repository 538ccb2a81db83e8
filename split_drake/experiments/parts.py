"""The parts of a file that takes long to make, kept beside it until all of them are there."""

import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from split_drake.experiments.run import claim_folder

_SUFFIX = ".npz"


class Parts:
    """Numbered parts of a file.

    Args:
        folder: that they lie in.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def path(self, number: int) -> Path:
        """Return where part `number` lies, or is to be written, atomically."""
        return self._folder / f"{number:06d}{_SUFFIX}"

    def missing(self, count: int) -> list[int]:
        """Return which of the first `count` parts are not there."""
        return [number for number in range(count) if not self.path(number).exists()]


@contextmanager
def parts_of(
    file: Path, config: Mapping[str, Any], free_keys: Collection[str] = ()
) -> Iterator[Parts]:
    """Give the parts of `file` that an earlier call has left, and remove them in the end.

    Left by an exception they stay, in `<file>.parts`, and the same call goes on from there.

    Args:
        file: that is made of them.
        config: what it was asked for with, as `claim_folder` has it.
        free_keys: of that, what may differ when it goes on.

    Raises AnotherRunError where the parts there are of something else, and FolderInUseError where
    another process makes them.
    """
    folder = file.with_name(f"{file.name}.parts")
    with claim_folder(folder, config, free_keys):
        try:
            yield Parts(folder)
        except KeyboardInterrupt:
            raise SystemExit(f"interrupted; the same command goes on from {folder}") from None
    shutil.rmtree(folder)
