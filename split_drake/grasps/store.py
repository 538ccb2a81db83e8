"""Grasps that were tried in physics, kept in the repository so that nobody tries them twice.

``models/mugs/grasps_{train,test}.npz`` hold, for the mugs of a fixed split one after another, what
`check_grasps` found.
"""

from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from split_drake.bad_input import BadInputError
from split_drake.files import interpreting, read_npz, replacing, split_rows
from split_drake.grasps.free_hand import MAX_SLIP_M, MAX_TURN_RAD
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.poses import Array

_WHAT = "a store of checked grasps"
# Two grasps of a mug, mirrored in the plane y = 0 of O; the hand is its own mirror image too.
_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


class GraspStoreError(BadInputError):
    """A store is missing, or was made for other mugs."""


@dataclass(frozen=True)
class CheckedGrasps:
    """Grasps of one mug and what became of them in a free hand, see `FreeHand.try_grasp`.

    Attributes:
        X_OGs: (N, 4, 4) grasps, the first ones best spread over the mug.
        openings_m: (N,) how far the pads are apart as the hand comes in.
        qualities: (N,) geometric, see `GraspJudge.qualities`.
        faults: (N,) why a grasp does not hold, "" where it does.
        slips_m: (N,) how far O moved in the closed hand; inf where there was nothing to move.
        turns_rad: (N,) how far the mug turned in it.
    """

    X_OGs: Array
    openings_m: Array
    qualities: Array
    faults: NDArray[np.str_]
    slips_m: Array
    turns_rad: Array

    def __len__(self) -> int:
        return len(self.X_OGs)

    @property
    def holds(self) -> NDArray[np.bool_]:
        """(N,): whether each grasp holds."""
        return self.faults == ""

    @property
    def robustness(self) -> Array:
        """(N,) in [0, 1]: 1 where nothing moved, 0 where the mug moved as far as is allowed."""
        worst = np.maximum(self.slips_m / MAX_SLIP_M, self.turns_rad / MAX_TURN_RAD)
        return np.where(self.holds, np.clip(1.0 - worst, 0.0, 1.0), 0.0)

    def with_mirror_images(self) -> Self:
        """Return the grasps and their mirror images, (2N): as good, mugs being symmetric."""
        doubled = {f.name: np.concatenate([getattr(self, f.name)] * 2) for f in fields(self)}
        doubled["X_OGs"] = np.concatenate([self.X_OGs, _MIRROR @ self.X_OGs @ _MIRROR])
        return type(self)(**doubled)


def store_path(mugs: str) -> Path:
    """Return where the grasps of a split's or a folder's mugs are kept."""
    return MugSource(mugs).derived_path("grasps")


def write_store(path: Path, grasps: dict[str, CheckedGrasps], sha256: str) -> None:
    """Write the grasps of some mugs, by their names, to `path`."""
    arrays = {
        f.name: np.concatenate([getattr(checked, f.name) for checked in grasps.values()])
        for f in fields(CheckedGrasps)
    }
    compact = {
        name: array if array.dtype.kind == "U" else array.astype(np.float32)
        for name, array in arrays.items()
    }
    with replacing(path) as temporary:
        np.savez_compressed(
            temporary,
            allow_pickle=False,
            names=np.array(list(grasps)),
            counts=np.array([len(checked) for checked in grasps.values()]),
            mugs_sha256=np.array(sha256),
            **compact,
        )


def read_store(path: Path, sha256: str) -> dict[str, CheckedGrasps]:
    """Return the grasps in `path` by the names of their mugs.

    Raises GraspStoreError where the file is missing or was made for other mugs than those whose
    parameters have this SHA-256, and UnreadableFileError where it is damaged.
    """
    if not path.is_file():
        raise GraspStoreError(f"{path} is missing: run python -m split_drake.grasps.check_grasps")
    keys = [f.name for f in fields(CheckedGrasps)]
    arrays = read_npz(path, _WHAT, required=("mugs_sha256", "counts", "names", *keys))
    if (found := str(arrays["mugs_sha256"])) != sha256:
        raise GraspStoreError(
            f"{path} was made for mugs of SHA-256 {found[:12]}, but they have "
            f"{sha256[:12]}; python -m split_drake.grasps.check_grasps makes it anew"
        )
    with interpreting(path, _WHAT):
        counts = arrays["counts"]
        parts = {key: split_rows(arrays[key], counts, key) for key in keys}
        return {
            str(name): CheckedGrasps(**{key: _as_read(part[i]) for key, part in parts.items()})
            for i, name in enumerate(arrays["names"])
        }


def _as_read(array: np.ndarray) -> np.ndarray:
    return array if array.dtype.kind == "U" else array.astype(float)


@lru_cache(maxsize=2)
def _kept(path: Path, source: MugSource) -> dict[str, CheckedGrasps]:
    return read_store(path, source.mugs_sha256())


def load_checked_grasps(mugs: str, name: str) -> CheckedGrasps:
    """Return the checked grasps of the mug `name` of a split or a folder.

    Raises GraspStoreError where there are none.
    """
    return grasps_in(store_path(mugs), MugSource(mugs), name)


def grasps_in(path: Path, source: MugSource, name: str) -> CheckedGrasps:
    """Return the checked grasps of one of a source's mugs from the file that keeps them.

    Raises GraspStoreError where there are none, or the file is of other mugs.
    """
    grasps = _kept(path, source)
    if name not in grasps:
        raise GraspStoreError(
            f"no grasps of {name!r} were checked; expected one of {source.where}'s mugs"
        )
    return grasps[name]
