"""Motions as rows of plain numbers, for other robots' drivers and other simulations."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from split_drake.bad_input import BadInputError
from split_drake.files import write_atomically
from split_drake.robot.panda import ARM_JOINTS

FORMAT = "split-drake motion 1"


class MotionFileError(BadInputError):
    """A file that holds no exported motion, or one that cannot be written as asked."""


@dataclass(frozen=True)
class PlanRow:
    """What the robot is told at one moment.

    Attributes:
        time_s: since the start; rows are 10 ms apart.
        q: joint angles of the arm, panda_joint1 to panda_joint7, rad.
        v: their velocities, rad/s.
        opening_m: distance between the pads; below 0 they squeeze with `force_n`.
        force_n: limit of each finger's force.
        segment: of which the row is part.
    """

    time_s: float
    q: tuple[float, ...]
    v: tuple[float, ...]
    opening_m: float
    force_n: float
    segment: str


def export_rows(path: Path, rows: Sequence[PlanRow]) -> None:
    """Write rows as CSV or JSON, by the file's suffix, atomically.

    CSV has a line a row; its first line names columns and units.  JSON has a list a column, of the
    same numbers, and says what they are.

    Raises MotionFileError where the suffix is another.
    """
    if path.suffix not in (".csv", ".json"):
        raise MotionFileError(f"{path} ends in {path.suffix!r}; expected .csv or .json")
    write_atomically(path, _csv(rows) if path.suffix == ".csv" else _json(rows))


def import_rows(path: Path) -> list[PlanRow]:
    """Return the rows that `export_rows` wrote as JSON.

    Raises MotionFileError where the file holds anything else.
    """
    try:
        fields = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise MotionFileError(f"{path} is no exported motion: {error}") from error
    if not isinstance(fields, dict) or fields.get("format") != FORMAT:
        raise MotionFileError(f"{path} is no exported motion; expected the format {FORMAT!r}")
    return _rows_of(path, fields)


def _rows_of(path: Path, fields: dict[str, Any]) -> list[PlanRow]:
    names = ("time_s", "q_rad", "v_rad_per_s", "opening_m", "force_n", "segment")
    if missing := [name for name in names if name not in fields]:
        raise MotionFileError(f"{path} has no {', '.join(missing)}; expected {', '.join(names)}")
    try:
        rows = [
            PlanRow(float(time), tuple(q), tuple(v), float(opening), float(force), str(segment))
            for time, q, v, opening, force, segment in zip(
                *(fields[name] for name in names), strict=True
            )
        ]
    except (TypeError, ValueError) as error:
        raise MotionFileError(f"{path} has columns that do not fit: {error}") from error
    for row in rows:
        numbers = np.array([row.time_s, *row.q, *row.v, row.opening_m, row.force_n], dtype=float)
        if len(row.q) != 7 or len(row.v) != 7 or not np.isfinite(numbers).all():
            raise MotionFileError(
                f"{path} has at {row.time_s} s not seven finite angles and speeds"
            )
    return rows


def _csv(rows: Sequence[PlanRow]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    angles = [f"{name}_rad" for name in ARM_JOINTS]
    speeds = [f"{name}_rad_per_s" for name in ARM_JOINTS]
    writer.writerow(["time_s", *angles, *speeds, "opening_m", "force_n", "segment"])
    for row in rows:
        writer.writerow([row.time_s, *row.q, *row.v, row.opening_m, row.force_n, row.segment])
    return text.getvalue()


def _json(rows: Sequence[PlanRow]) -> str:
    content = {
        "format": FORMAT,
        "about": "rows 10 ms apart; opening_m is the distance between the pads, below 0 they "
        "squeeze with at most force_n a finger",
        "joints": list(ARM_JOINTS),
        "time_s": [row.time_s for row in rows],
        "q_rad": [row.q for row in rows],
        "v_rad_per_s": [row.v for row in rows],
        "opening_m": [row.opening_m for row in rows],
        "force_n": [row.force_n for row in rows],
        "segment": [row.segment for row in rows],
    }
    return json.dumps(content) + "\n"
