"""Mugs from files, checked before a run's first trial, their true grasps kept in its folder."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from split_drake.files import interpreting, read_npz, replacing
from split_drake.grasps.sampling import SCANNED_WIDTH_M, GraspLabels, sample_grasps
from split_drake.objects.scanned.files import ReadMug
from split_drake.station.config import StationConfig
from split_drake.station.station import Station

# Entry of a run's folder with the true grasps of its mugs.
GRASPS = "grasps"


@dataclass(frozen=True)
class MugCheck:
    """What a mug must go through before a run; called in a process of its own.

    Attributes:
        station: that the mug is to be simulated in.
        scratch: folder that its true grasps are written to; None where none are needed.
        folder: of the run, which may have them already.
    """

    station: StationConfig
    scratch: Path | None
    folder: Path

    def __call__(self, name: str, mug: ReadMug) -> None:
        """Raise ValueError or RuntimeError where a mug cannot be simulated, or has no grasp."""
        Station(self.station, [mug.shape.body])  # Drake refuses bodies that cannot be
        if self.scratch is not None and not grasps_path(self.folder, name).exists():
            rng = np.random.default_rng(0)
            labels = sample_grasps(mug.shape.body, rng, min_width_m=SCANNED_WIDTH_M)
            _write(grasps_path(self.scratch, name), labels)


def keep_grasps(scratch: Path, folder: Path) -> None:
    """Copy the true grasps that `MugCheck` wrote to the folder of a run, which lacks them."""
    for path in sorted((scratch / GRASPS).glob("*.npz")):
        with replacing(folder / GRASPS / path.name) as temporary:
            shutil.copyfile(path, temporary)


def grasps_path(folder: Path, name: str) -> Path:
    """Return where a run keeps the true grasps of a mug."""
    return folder / GRASPS / f"{name}.npz"


def read_grasps(folder: Path, name: str) -> GraspLabels:
    """Return the true grasps that a run kept; raise MissingFileError without."""
    path, what = grasps_path(folder, name), "the true grasps of a mug"
    arrays = read_npz(path, what, required=_label_fields())
    with interpreting(path, what):
        return GraspLabels(**{key: arrays[key] for key in _label_fields()})


def _write(path: Path, labels: GraspLabels) -> None:
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **{key: getattr(labels, key) for key in _label_fields()})


def _label_fields() -> Sequence[str]:
    return [entry.name for entry in fields(GraspLabels)]
