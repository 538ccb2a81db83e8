"""A run's folder: what was asked, a log of what arose, and going on after an interruption."""

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from split_drake.bad_input import BadInputError
from split_drake.experiments.lock import FolderChangedError, FolderLock, locked
from split_drake.files import (
    UnreadableFileError,
    interpreting,
    read_json_object,
    write_atomically,
    write_json,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")

CONFIG = "config.json"
# Kept for information: what a run was made with is told by the hash of the code beside it.
_INFORMATION = ("commit", "processor")
# Values in a message are cut to this many characters.
_SHOWN = 80


class AnotherRunError(BadInputError):
    """A folder holds a run with other options, data, weights or code."""


class NoResultsError(BadInputError):
    """All of a run ended in errors."""


def require_results(errors: Sequence[str], asked: int, folder: Path) -> None:
    """Raise NoResultsError where all that was run, `asked` of it, ended in `errors`.

    The same command tries them again.
    """
    if asked and len(errors) == asked:
        first = errors[0].strip().splitlines()[-1] if errors[0].strip() else "without a reason"
        raise NoResultsError(
            f"{folder} holds no result: all {asked} ended in an error, the first in: {first}"
        )


def as_json(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values as JSON gives them back: lists for tuples and arrays, texts for paths.

    Raises BadInputError where one of them is NaN or infinite, which JSON does not have.
    """
    for key, value in config.items():
        try:
            json.dumps(value, default=_plain, allow_nan=False)
        except ValueError as error:
            raise BadInputError(f"{key} is {_shown(value)}; expected finite numbers") from error
    return dict(json.loads(json.dumps(config, default=_plain)))


def _plain(value: object) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def require_same(
    folder: Path,
    before: Mapping[str, Any],
    config: Mapping[str, Any],
    free_keys: Collection[str] = (),
) -> None:
    """Raise AnotherRunError, naming what differs, where `config` is not that of the run before.

    What is in `free_keys` may differ.
    """
    changed = [
        f"{key} was {_shown(before.get(key))}, is {_shown(config.get(key))}"
        for key in sorted(before.keys() | config.keys())
        if key not in free_keys and before.get(key) != config.get(key)
    ]
    if changed:
        raise AnotherRunError(
            f"{folder} holds another run ({'; '.join(changed)}); choose another folder"
        )


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


@contextmanager
def claim_folder(
    folder: Path, config: Mapping[str, Any], free_keys: Collection[str] = ()
) -> Iterator[dict[str, Any]]:
    """Keep a folder for one run: lock it, write config.json, and give its content as JSON has it.

    What is in `free_keys` may differ from before, and so may the commit.

    Raises AnotherRunError where the folder holds a run that was asked for something else, or files
    that are of no run; FolderInUseError where another process runs there; and, at the end,
    FolderChangedError where the folder has vanished.
    """
    wanted = as_json(config)
    with _claimed(folder, wanted, free_keys):
        yield wanted


@contextmanager
def _claimed(
    folder: Path, wanted: Mapping[str, Any], free_keys: Collection[str]
) -> Iterator[FolderLock]:
    _require_same_run(folder, wanted, free_keys)  # before anything is made in it
    with locked(folder) as lock:
        _require_same_run(folder, wanted, free_keys)
        write_json(folder / CONFIG, wanted)
        yield lock


def _require_same_run(folder: Path, wanted: Mapping[str, Any], free_keys: Collection[str]) -> None:
    path = folder / CONFIG
    if path.exists():
        free = (*free_keys, *_INFORMATION)
        require_same(folder, read_json_object(path, "the options of a run"), wanted, free)
    else:
        require_no_files(folder)


def require_no_files(folder: Path) -> None:
    """Raise AnotherRunError where a folder without config.json holds anything of somebody else's.

    Hidden files do not count: a lock, or what a kill left of a file half written.
    """
    if not folder.is_dir():
        return
    if names := sorted(path.name for path in folder.iterdir() if not path.name.startswith(".")):
        raise AnotherRunError(
            f"{folder} holds {_shown(', '.join(names))}, but no {CONFIG}: it is no folder of an "
            "earlier run; choose a new or an empty folder"
        )


class RunFolder(Generic[Record]):
    """A folder with config.json and a log, one line of JSON for each record.

    Args:
        path: of the folder.
        log: name of the log's file.
        from_fields: makes a record, a dataclass, of what its line holds.
    """

    def __init__(
        self, path: Path, log: str, from_fields: Callable[[dict[str, Any]], Record]
    ) -> None:
        self.path = path
        self.log = path / log
        self._from_fields = from_fields
        self._lock: FolderLock | None = None

    @contextmanager
    def claim(
        self,
        config: Mapping[str, Any],
        free_keys: Collection[str] = (),
        again: Callable[[Record], bool] = lambda record: False,
    ) -> Iterator[None]:
        """Claim the folder, as `claim_folder` does, and mend a log that a kill cut off.

        Records that are to be made `again`, those of errors say, are taken out of the log.
        """
        with _claimed(self.path, as_json(config), free_keys) as self._lock:
            records = self.records()
            lines = read_json_lines(self.log)
            kept = [line for line, found in zip(lines, records, strict=True) if not again(found)]
            write_atomically(self.log, "".join(_line(fields) + "\n" for fields in kept))
            yield
        self._lock = None

    def require_unchanged(self) -> None:
        """Raise FolderChangedError where the claimed folder was removed or replaced since."""
        if self._lock is not None:
            self._lock.require_unchanged()

    def records(self) -> list[Record]:
        """Return the records that the log holds, in their order; [] where there is no log.

        A last line that was cut off by a kill is left out.  Raises UnreadableFileError naming any
        other line that is no record.
        """
        records = []
        for number, fields in enumerate(read_json_lines(self.log), start=1):
            with interpreting(f"{self.log}:{number}", "a record of such a run"):
                records.append(self._from_fields(fields))
        return records

    def append(self, record: Record) -> None:
        """Add a record to the log; FolderChangedError where the claimed folder has vanished."""
        self.require_unchanged()
        with self.log.open("a") as file:
            file.write(json_line(record) + "\n")

    def _lines(self) -> list[str]:
        return self.log.read_text().splitlines() if self.log.exists() else []

    def collect(
        self,
        arriving: Iterable[Record],
        expected: int,
        console: Console,
        describe: Callable[[Sequence[Record]], str] = lambda records: "",
        remark: Callable[[Record], str] = lambda record: "",
    ) -> None:
        """Append records to the log as they arise, and show how many are there.

        Ctrl-C ends it: what has arisen is kept, and a line says how to go on.

        Args:
            arriving: the records.
            expected: how many of them there will be; nothing is shown of none.
            console: to show it on.
            describe: says beside the bar what all records so far come to.
            remark: says what a record is worth a line for; nothing where it is empty.

        Raises FolderChangedError where the log does not hold in the end what was written to it.
        """
        if not expected:
            return
        records, lines = self.records(), self._lines()
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
        progress = Progress(
            *columns,
            TimeRemainingColumn(),
            console=console,
            disable=console.quiet,
        )
        try:
            with progress:
                bar = progress.add_task("", total=len(records) + expected, completed=len(records))
                for record in arriving:
                    self.append(record)
                    records.append(record)
                    lines.append(json_line(record))
                    if line := remark(record):
                        progress.console.print(line, markup=False)
                    progress.update(bar, advance=1, description=describe(records))
        except KeyboardInterrupt:
            console.print(f"interrupted; --out {self.path} goes on from here", markup=False)
        self.require_unchanged()
        if (found := self._lines()) != lines:
            raise FolderChangedError(
                f"{self.log} holds {len(found)} records, expected the {len(lines)} that were "
                "written: something else changed it while this run went on"
            )


def json_line(record: "DataclassInstance") -> str:
    """Return a dataclass as one line of JSON, without its line break."""
    return _line(asdict(record))


def _line(fields: Mapping[str, Any]) -> str:
    return json.dumps(fields, separators=(",", ":"))


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects in a file of JSON lines; [] where there is no file.

    A last line that was cut off by a kill is left out.  Raises UnreadableFileError naming any other
    line that holds no object.
    """
    if not path.exists():
        return []
    lines = path.read_bytes().split(b"\n")
    found = []
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            fields = json.loads(line)
        except (ValueError, RecursionError) as error:
            if number == len(lines):
                break
            raise UnreadableFileError(f"{path}:{number} is not JSON: {error}") from error
        if not isinstance(fields, dict):
            raise UnreadableFileError(f"{path}:{number} holds {_shown(fields)}; expected an object")
        found.append(fields)
    return found
