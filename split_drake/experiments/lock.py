"""A folder that one process alone writes to."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from split_drake.bad_input import BadInputError

# Left in the folder: a file that were deleted could be locked by two processes under one name.
LOCK = ".lock"


class FolderInUseError(BadInputError):
    """Another process writes to the folder."""


class FolderChangedError(BadInputError):
    """A folder was removed, or its content changed, while a run wrote to it."""


class FolderLock:
    """A folder that is this process's alone until the lock is closed, or the process ends.

    Args:
        folder: that was locked.
        file: the open lock file in it.
    """

    def __init__(self, folder: Path, file: TextIO) -> None:
        self._folder = folder
        self._file = file

    def require_unchanged(self) -> None:
        """Raise FolderChangedError where the folder was removed or replaced since."""
        if not _is_at(self._file, self._folder / LOCK):
            raise FolderChangedError(
                f"{self._folder} was removed or replaced while this run wrote to it; what it held "
                "is lost, so run it again"
            )


@contextmanager
def locked(folder: Path) -> Iterator[FolderLock]:
    """Make the folder where it is missing, and keep other processes out of it.

    The lock ends with its process, however that ends.  At its end FolderChangedError is raised
    where the folder was removed or replaced since.  A folder that was made for what raises before
    it wrote anything is removed again.

    Raises FolderInUseError where another process holds the folder, and BadInputError where it
    cannot be written to.
    """
    was_there = folder.exists()
    with _opened(folder) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FolderInUseError(
                f"{folder} is in use: another process{_holder(folder)} runs there; wait for it, or "
                "choose another folder"
            ) from None
        file.seek(0)
        file.truncate()
        file.write(f"{os.getpid()}\n")
        file.flush()
        lock = FolderLock(folder, file)
        lock.require_unchanged()
        try:
            yield lock
        except BaseException:
            if not was_there:
                _remove_if_empty(folder)
            raise
        lock.require_unchanged()


def _remove_if_empty(folder: Path) -> None:
    if folder.is_dir() and [path.name for path in folder.iterdir()] == [LOCK]:
        (folder / LOCK).unlink()
        folder.rmdir()


def _opened(folder: Path) -> TextIO:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return (folder / LOCK).open("a+")
    except OSError as error:
        raise BadInputError(
            f"{folder} cannot be written to ({error.strerror}); expected a folder for results"
        ) from error


def _holder(folder: Path) -> str:
    """Return the number of the process that holds the folder, for a message."""
    try:
        text = (folder / LOCK).read_text().strip()
    except OSError:
        return ""
    return f" ({text})" if text.isdecimal() else ""


def _is_at(file: TextIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
