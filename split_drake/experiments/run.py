"""A run's folder: what was asked, a log of what arose, and going on after an interruption."""

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from split_drake.bad_input import BadInputError
from split_drake.files import write_atomically, write_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")

CONFIG = "config.json"
# Values in a message are cut to this many characters.
_SHOWN = 80


class AnotherRunError(BadInputError):
    """A folder holds a run with other options, data, weights or code."""


def as_json(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values as JSON gives them back: lists for tuples and arrays, texts for paths."""
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


def claim_folder(
    folder: Path, config: Mapping[str, Any], free_keys: Collection[str] = ()
) -> dict[str, Any]:
    """Make the folder, write config.json, and return its content.

    Raises AnotherRunError where the folder holds a run that was asked for something else; what is
    in `free_keys` may differ.
    """
    path, wanted = folder / CONFIG, as_json(config)
    if path.exists():
        require_same(folder, json.loads(path.read_text()), wanted, free_keys)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(path, wanted)
    return wanted


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

    def claim(self, config: Mapping[str, Any], free_keys: Collection[str] = ()) -> None:
        """Claim the folder, as `claim_folder` does, and mend a log that a kill cut off."""
        claim_folder(self.path, config, free_keys)
        lines = read_json_lines(self.log)
        write_atomically(self.log, "".join(_line(fields) + "\n" for fields in lines))

    def records(self) -> list[Record]:
        """Return the records that the log holds, in their order; [] where there is no log.

        A last line that was cut off by a kill is left out; any other bad line raises ValueError.
        """
        return [self._from_fields(fields) for fields in read_json_lines(self.log)]

    def append(self, record: Record) -> None:
        """Add a record to the log."""
        with self.log.open("a") as file:
            file.write(json_line(record) + "\n")

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
        """
        if not expected:
            return
        records = self.records()
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
                    if line := remark(record):
                        progress.console.print(line, markup=False)
                    progress.update(bar, advance=1, description=describe(records))
        except KeyboardInterrupt:
            console.print(f"interrupted; --out {self.path} goes on from here", markup=False)


def json_line(record: "DataclassInstance") -> str:
    """Return a dataclass as one line of JSON, without its line break."""
    return _line(asdict(record))


def _line(fields: Mapping[str, Any]) -> str:
    return json.dumps(fields, separators=(",", ":"))


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """Return the objects in a file of JSON lines; [] where there is no file.

    A last line that was cut off by a kill is left out; any other bad line raises ValueError.
    """
    if not path.exists():
        return []
    lines = path.read_text().split("\n")
    found = []
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError as error:
            if number == len(lines):
                break
            raise ValueError(f"{path}:{number} is not JSON: {error}") from error
    return found
