"""Files that are never half written, and whose readers say which file cannot be used, and why."""

import gzip
import json
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from split_drake.bad_input import BadInputError

Arrays = dict[str, np.ndarray]


class UnreadableFileError(BadInputError):
    """A file is damaged, or holds something else than was expected."""


class MissingFileError(BadInputError, FileNotFoundError):
    """There is no such file."""


def read_npz(path: Path | str, what: str, required: Sequence[str] = ()) -> Arrays:
    """Return {name: array} of an npz; nothing in it is ever unpickled.

    Args:
        path: of the file.
        what: the file should be, for the message: "a file of pose sets".
        required: names that it must have.

    Raises MissingFileError, and UnreadableFileError where it is damaged, no npz, holds pickled
    objects or lacks a name.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}; expected {what}")
    # NumPy, zipfile and zlib raise errors of a dozen kinds where bytes are damaged.
    with _whatever_fails(path, what, Exception), np.load(path, allow_pickle=False) as archive:
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise TypeError("it holds a single array")
        arrays = {name: np.asarray(archive[name]) for name in archive.files}
    if missing := [name for name in required if name not in arrays]:
        raise UnreadableFileError(
            f"{path} holds {', '.join(sorted(arrays)) or 'nothing'}, but no {missing[0]!r}; "
            f"expected {what}"
        )
    return arrays


def read_gzip(path: Path | str, what: str) -> str:
    """Return the text that a file holds, compressed.

    Raises MissingFileError, and UnreadableFileError where it is damaged; `what` it should be.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}; expected {what}")
    with _whatever_fails(path, what, OSError, EOFError, ValueError, zlib.error):
        return gzip.decompress(path.read_bytes()).decode()


def read_json(path: Path | str, what: str) -> Any:
    """Return what a JSON file holds; see `read_npz` for `what` and the errors."""
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}; expected {what}")
    with _whatever_fails(path, what, OSError, ValueError, RecursionError):
        return json.loads(path.read_bytes())


def read_json_object(path: Path | str, what: str) -> dict[str, Any]:
    """Return the object that a JSON file holds; see `read_npz` for `what` and the errors."""
    content = read_json(path, what)
    if not isinstance(content, dict):
        raise UnreadableFileError(
            f"{path} holds {json.dumps(content)[:_SHOWN]}, no object; expected {what}"
        )
    return content


def split_rows(rows: np.ndarray, counts: np.ndarray, name: str) -> list[np.ndarray]:
    """Return `rows` (M, ...) in pieces of so many each; ValueError where they are not M in all."""
    if counts.ndim != 1 or counts.dtype.kind not in "iu" or (counts < 0).any():
        raise ValueError(f"the counts of {name} are {counts!r:.80}; expected whole numbers")
    if rows.ndim < 1 or int(counts.sum()) != len(rows):
        raise ValueError(f"{name} has shape {rows.shape}; its counts say {int(counts.sum())} rows")
    return np.split(rows, np.cumsum(counts)[:-1]) if len(counts) else []


@contextmanager
def interpreting(path: Path | str, what: str) -> Iterator[None]:
    """Turn what goes wrong with a file's content into UnreadableFileError.

    Bad input that is told already, with the path, stays as it is.
    """
    with _whatever_fails(path, what, LookupError, TypeError, ValueError, ArithmeticError):
        yield


@contextmanager
def _whatever_fails(path: Path | str, what: str, *kinds: type[Exception]) -> Iterator[None]:
    try:
        yield
    except BadInputError as error:
        if str(path) in str(error):
            raise
        raise UnreadableFileError(f"{path}: {error}") from error
    except kinds as error:
        told = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        # What is damaged may be quoted, binary and at length.
        told = ascii(told.splitlines()[0][:_TOLD])[1:-1] if told else type(error).__name__
        raise UnreadableFileError(f"{path} is damaged or not {what}: {told}") from error


_SHOWN, _TOLD = 40, 200


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a path to write to, of the same suffix, that takes the place of `path` afterwards.

    A reader sees either the old file or the whole new one; what fails leaves the old one as it is.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(
        dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix, delete=False
    ) as file:
        temporary = Path(file.name)
    try:
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write `content` so that a reader sees either the old file or the whole new one."""
    with replacing(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON, atomically."""
    write_atomically(path, json.dumps(content, indent=1) + "\n")
