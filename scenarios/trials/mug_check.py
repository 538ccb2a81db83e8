"""Mugs from files, checked before a run's first trial, their true grasps kept in its folder."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from rich.console import Console

from split_drake.experiments.pool import WorkerPool
from split_drake.files import interpreting, read_npz, replacing
from split_drake.grasps.sampling import SCANNED_WIDTH_M, GraspLabels, sample_grasps
from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.station.config import StationConfig
from split_drake.station.station import Station

# A mug takes seconds.
_CHECK_LIMIT_S = 600.0


@dataclass(frozen=True)
class MugCheck:
    """What is to be checked.

    Attributes:
        source, name: of the mug.
        folder: of the run.
        with_grasps: whether true grasps are needed.
        station: that the mug is to be simulated in.
    """

    source: MugSource
    name: str
    folder: Path
    with_grasps: bool
    station: StationConfig


def check_mugs(
    source: MugSource,
    folder: Path,
    with_grasps: bool,
    station: StationConfig,
    workers: int,
    console: Console,
) -> None:
    """Check that every mug of a folder can be simulated, and write its true grasps if needed.

    Raises InvalidMugError with one line for every mug that is refused.
    """
    names = source.names()
    checks = [MugCheck(source, name, folder, with_grasps, station) for name in names]
    pool = WorkerPool(check_mug, workers, crashed_check, limit_s=_CHECK_LIMIT_S)
    with console.status(f"checking {len(names)} mugs of {source.where}"):
        faults = sorted(fault for fault in pool.run(checks) if fault)
    if faults:
        raise InvalidMugError("\n".join(["mugs are refused:", *faults]))


def check_mug(check: MugCheck) -> str:
    """Return why a mug is refused, or an empty string."""
    try:
        mug = check.source.load(check.name)
        Station(check.station, [mug.body])  # Drake refuses bodies that cannot be
        path = grasps_path(check.folder, check.name)
        if check.with_grasps and not path.exists():
            rng = np.random.default_rng(0)
            _write(path, sample_grasps(mug.body, rng, min_width_m=SCANNED_WIDTH_M))
    except (InvalidMugError, ValueError, RuntimeError) as error:
        return str(error) if check.name in str(error) else f"{check.name}: {error}"
    return ""


def crashed_check(check: MugCheck, reason: str) -> str:
    """Return why a mug is refused whose check took its process down, or too long."""
    return f"{check.name}: while it was loaded, {reason}"


def grasps_path(folder: Path, name: str) -> Path:
    """Return where a run keeps the true grasps of a mug."""
    return folder / "grasps" / f"{name}.npz"


def read_grasps(folder: Path, name: str) -> GraspLabels:
    """Return the true grasps that `check_mugs` wrote; raise MissingFileError without."""
    path, what = grasps_path(folder, name), "the true grasps of a mug"
    arrays = read_npz(path, what, required=_label_fields())
    with interpreting(path, what):
        return GraspLabels(**{key: arrays[key] for key in _label_fields()})


def _write(path: Path, labels: GraspLabels) -> None:
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **{key: getattr(labels, key) for key in _label_fields()})


def _label_fields() -> Sequence[str]:
    return [entry.name for entry in fields(GraspLabels)]
