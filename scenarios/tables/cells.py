"""What the runs of Table I come to: a cell for each method and kind of scene."""

import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenarios.clutter.records import Removal, RoundRecord, clutter_run
from scenarios.clutter.spec import SceneKind
from scenarios.tables.rows import SCENES, TableRow
from split_drake.bad_input import BadInputError
from split_drake.experiments.run import CONFIG, json_line
from split_drake.files import (
    interpreting,
    read_gzip,
    read_json_object,
    write_atomically,
    write_json,
)

# Rounds that are kept, a line of JSON each.
KEPT = "rounds.jsonl.gz"
_WHAT = "the rounds of a cell"
_OF_A_MACHINE = ("out", "workers", "scheduler", "limit_s", "record", "shard")
# What has to be the same in all cells of a table, and in those of one kind of scene: methods meet
# the same scenes, and their grasps the same physics.
SAME = ("noise", "fit_table", "select", "robot", "first_seed", "physics")
SAME_IN_A_COLUMN = ("objects_sha256",)


@dataclass(frozen=True)
class Cell:
    """The rounds of one method in one kind of scene.

    Attributes:
        row: the method.
        scene: the kind.
        records: of the rounds, in the order of seeds and numbers.
        removal: what they come to.
        config: what was run.
    """

    row: TableRow
    scene: SceneKind
    records: tuple[RoundRecord, ...]
    removal: Removal
    config: Mapping[str, Any]


def cell_folder(out: Path, row: TableRow, scene: SceneKind) -> Path:
    """Return the folder of a cell's run."""
    return out / f"{row.name}-{scene}"


def read_cell(out: Path, row: TableRow, scene: SceneKind, rounds: int, seeds: range) -> Cell | None:
    """Return a cell, of those rounds and seeds that were run; None where none was.

    Rounds that ended in an error of the program are no rounds.  The folder may hold runs, or what
    `keep_cells` made of them.
    """
    folder = cell_folder(out, row, scene)
    if not (folder / CONFIG).is_file():
        return None
    kept = folder / KEPT
    found = kept_rounds(kept) if kept.is_file() else clutter_run(folder).records()
    records = [
        record
        for record in found
        if record.seed in seeds and record.index < rounds and not record.failed_to_run
    ]
    if not records:
        return None
    records.sort(key=lambda each: (each.seed, each.index))
    config = read_json_object(folder / CONFIG, "the options of a run")
    return Cell(row, scene, tuple(records), Removal.of(records), config)


def keep_cells(cells: Sequence[Cell], out: Path) -> None:
    """Write options and rounds of each cell to a folder, compressed, without pages and recordings.

    The same cells make the same bytes.
    """
    for cell in cells:
        folder = cell_folder(out, cell.row, cell.scene)
        lines = "".join(json_line(record) + "\n" for record in cell.records)
        write_atomically(folder / KEPT, gzip.compress(lines.encode(), mtime=0))
        write_json(folder / CONFIG, _of_any_machine(cell.config))


def _of_any_machine(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a run's options without those of its machine, and of paths the last names."""
    kept = {name: value for name, value in config.items() if name not in _OF_A_MACHINE}
    for name in ("checkpoint", "objects"):
        if kept.get(name):
            kept[name] = "/".join(Path(kept[name]).parts[-2:])
    return kept


def kept_rounds(path: Path) -> list[RoundRecord]:
    """Return the rounds that `keep_cells` wrote to a file.

    Raises UnreadableFileError where it is damaged.
    """
    lines = read_gzip(path, _WHAT).splitlines()
    with interpreting(path, _WHAT):
        return [RoundRecord.from_fields(json.loads(line)) for line in lines]


def require_comparable(cells: Sequence[Cell]) -> None:
    """Raise BadInputError naming the first cell that was run in other conditions than the rest."""
    for cell in cells[1:]:
        _require_same(cells[0], cell, SAME)
    for scene in SCENES:
        column = [cell for cell in cells if cell.scene == scene]
        for cell in column[1:]:
            _require_same(column[0], cell, SAME_IN_A_COLUMN)


def _require_same(first: Cell, second: Cell, keys: Sequence[str]) -> None:
    for key in keys:
        if (of_first := first.config.get(key)) == (of_second := second.config.get(key)):
            continue
        raise BadInputError(
            f"{second.row.name}-{second.scene} has {key} {_what_differs(of_second, of_first)}, "
            f"{first.row.name}-{first.scene} has {_what_differs(of_first, of_second)}; "
            "a table needs the same"
        )


def _what_differs(value: object, other: object) -> str:
    """Return a value, and of one with entries those that another lacks."""
    if isinstance(value, Mapping) and isinstance(other, Mapping):
        value = {key: each for key, each in value.items() if other.get(key) != each}
    return repr(value)
