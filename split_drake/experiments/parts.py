"""The parts of a file that takes long to make, kept beside it until all of them are there."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track

from split_drake.experiments.lock import LOCK
from split_drake.experiments.run import CONFIG, AnotherRunError, claim_folder

Item = TypeVar("Item")
Made = TypeVar("Made")
PARTS = ".parts"
_SUFFIX = ".npz"


class Parts:
    """Numbered parts of a file.

    Attributes:
        stay: whether they are kept for another try once the file is made.

    Args:
        folder: that they lie in.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.stay = False

    def path(self, number: int) -> Path:
        """Return where part `number` lies, or is to be written, atomically."""
        return self._folder / f"{number:06d}{_SUFFIX}"

    def make(
        self,
        items: Sequence[Item],
        work: Callable[[list[Item]], Iterable[Made]],
        save: Callable[[Made], None],
        title: str,
        console: Console | None = None,
    ) -> None:
        """Make the parts that are missing, one for each item.

        Args:
            items: all of them, in the order of their parts' numbers.
            work: yields what it makes of items, as it arises.
            save: writes that to its part, or leaves it out.
            title: of the bar that shows how far the work is.
            console: to show it on.
        """
        missing = [item for number, item in enumerate(items) if not self.path(number).exists()]
        for made in track(work(missing), title, total=len(missing), console=console):
            save(made)


@contextmanager
def parts_of(
    file: Path, config: Mapping[str, Any], free_keys: Sequence[str] = ()
) -> Iterator[Parts]:
    """Give the parts of `file` that an earlier call has left, and remove them in the end.

    Left by an exception they stay, in `<file>.parts`, and the same call goes on from there.  Ctrl-C
    leaves it as SystemExit, which says so.

    Args:
        file: that is made of them.
        config: what it was asked for with, as `claim_folder` has it.
        free_keys: of that, what may differ when it goes on.

    Raises AnotherRunError where the parts there are of something else, and FolderInUseError where
    another process makes them.
    """
    folder = file.with_name(file.name + PARTS)
    try:
        with claim_folder(folder, config, free_keys):
            parts = Parts(folder)
            try:
                yield parts
            except KeyboardInterrupt:
                raise SystemExit(f"interrupted; the same command goes on from {folder}") from None
            if not parts.stay:
                _empty(folder)
    except AnotherRunError as error:
        raise AnotherRunError(f"{error}; or remove it to begin anew") from error
    if not parts.stay:
        # Another process may have claimed it since; then it is no longer empty, and stays.
        with suppress(OSError):
            (folder / LOCK).unlink()
            folder.rmdir()


def _empty(folder: Path) -> None:
    """Remove all parts of a claimed folder, and then what it is known by."""
    for path in (*folder.glob(f"*{_SUFFIX}"), folder / CONFIG):
        path.unlink()
