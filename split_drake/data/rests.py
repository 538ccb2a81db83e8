"""How objects come to rest on the table after a drop, in physics.

``python -m split_drake.data.rests`` writes ``models/mugs/rests_{train,test}.npz``, the rests of the
fixed splits' mugs, so that scenes are drawn as trials start without simulating a drop for each.
Interrupted, the same command goes on.
With ``--mugs DIR`` those of your own meshes go to ``datasets/mugs``.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from rich.console import Console
from scipy.spatial.transform import Rotation

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.parts import parts_of
from split_drake.experiments.pools import LOCAL, make_pool, require_scheduler
from split_drake.experiments.provenance import code_version
from split_drake.files import interpreting, read_npz, replacing
from split_drake.objects.rigid import RigidObject
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import usable_mugs
from split_drake.poses import Array
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_to_fields
from split_drake.station.station import Station
from split_drake.truth.rest import axis_tilt_rad, wait_for_rest
from split_drake.truth.starts import SETTLE_TIMEOUT_S, UPSIDE_DOWN_RAD, drop_pose
from split_drake.truth.state import Truth

# A drop off the table, or one that never ends, is drawn anew, but not for ever.
MAX_DRAWS_PER_REST = 20
_WHAT = "a file of rests"


class RestsError(BadInputError):
    """Rests are missing, or were made for other mugs."""


@dataclass(frozen=True)
class Rests:
    """Poses of an object at rest.

    Attributes:
        X_TOs: (K, 4, 4) poses; T lies on the table below the point of the drop, parallel to W.
        dropped: how many drops it took: those that ended upside down, or not at all, are left out.
    """

    X_TOs: Array
    dropped: int


def settle(body: RigidObject, count: int, rng: np.random.Generator, config: StationConfig) -> Rests:
    """Drop an object in any orientation until `count` drops have come to rest.

    Left out are rests upside down (as in the paper, section VI-B) and what still moves after 5 s.

    Raises RestsError where hardly any drop comes to rest.
    """
    station = Station(config, (body,))
    truth = Truth(station)
    p_WT = np.array(station.config.layout.workspace.p_WCenter)
    rests: list[Array] = []
    dropped = 0
    while len(rests) < count:
        if dropped == MAX_DRAWS_PER_REST * count:
            raise RestsError(f"only {len(rests)} of {dropped} drops of {body.name} came to rest")
        R_WO = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        station.place_object(0, drop_pose(body, R_WO, p_WT))
        dropped += 1
        if not wait_for_rest(station, truth, 0, SETTLE_TIMEOUT_S):
            continue
        X_TO = truth.X_WO(0)
        X_TO[:3, 3] -= p_WT
        if axis_tilt_rad(X_TO) <= UPSIDE_DOWN_RAD:
            rests.append(X_TO)
    return Rests(np.stack(rests), dropped)


def rests_path(mugs: str) -> Path:
    """Return where the rests of a split's or a folder's mugs are kept."""
    return MugSource(mugs).derived_path("rests")


@lru_cache(maxsize=2)
def _kept(path: Path, source: MugSource) -> dict[str, Rests]:
    if not path.is_file():
        raise RestsError(
            f"{path} is missing; python -m split_drake.data.rests --mugs {source.where} makes it"
        )
    return _read(path, source.mugs_sha256())


def _read(path: Path, mugs_sha256: str) -> dict[str, Rests]:
    """Return the rests in a file by their mugs' names.

    Raises RestsError where it is of others than those with that checksum.
    """
    keys = ("names", "X_TOs", "dropped")
    arrays = read_npz(path, _WHAT, required=("mugs_sha256", *keys))
    if (found := str(arrays["mugs_sha256"])) != mugs_sha256:
        raise RestsError(
            f"{path} was made for mugs of SHA-256 {found[:12]}, but they have {mugs_sha256[:12]}; "
            "python -m split_drake.data.rests makes it anew"
        )
    with interpreting(path, _WHAT):
        entries = zip(*(arrays[key] for key in keys), strict=True)
        return {str(name): Rests(X_TOs.astype(float), int(n)) for name, X_TOs, n in entries}


def load_rests(mugs: str, name: str) -> Rests:
    """Return the rests of the mug `name` of a split or a folder.

    Raises RestsError where there are none.
    """
    return rests_in(rests_path(mugs), MugSource(mugs), name)


def rests_in(path: Path, source: MugSource, name: str) -> Rests:
    """Return the rests of one of a source's mugs from the file that keeps them.

    Raises RestsError where there are none, or the file is of other mugs.
    """
    rests = _kept(path, source)
    if name not in rests:
        raise RestsError(f"there are no rests of {name!r}; expected one of {source.where}'s mugs")
    return rests[name]


@dataclass(frozen=True)
class SettleConfig:
    """Which mugs to drop, and how often.

    Attributes:
        mugs: "train", "test", or a folder of meshes.
        count: rests of each.
        workers: processes; the rests do not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
    """

    mugs: str = "train"
    count: int = 40
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("count", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")
        MugSource(self.mugs)


def _settle_mug(source: MugSource, count: int, layout: Layout, name: str) -> tuple[str, Rests]:
    mug = source.load(name)
    rng = np.random.default_rng(mug.seed)
    return name, settle(mug.body, count, rng, StationConfig(layout))


def settle_split(config: SettleConfig, layout: Layout) -> None:
    """Write the rests of a split's or a folder's mugs on the table of a layout.

    Those of each mug are kept as they arise, and the same call goes on with the others.
    """
    require_scheduler(config.scheduler)
    source = usable_mugs(MugSource(config.mugs), config.workers, Console()).source
    names, sha256 = list(source.names()), source.mugs_sha256()
    file = rests_path(config.mugs)
    file.parent.mkdir(parents=True, exist_ok=True)
    settle_mug = partial(_settle_mug, source, config.count, layout)
    pool = make_pool(config.scheduler, config.workers, settle_mug)
    asked = {"count": config.count, "layout": layout_to_fields(layout), "mugs_sha256": sha256}
    with parts_of(file, asked | code_version()) as parts:

        def save(found: tuple[str, Rests]) -> None:
            _save(parts.path(names.index(found[0])), sha256, dict([found]))

        parts.make(names, pool.run, save, "mugs")
        rests = [_read(parts.path(number), sha256)[name] for number, name in enumerate(names)]
        _save(file, sha256, dict(zip(names, rests, strict=True)))
    dropped = sum(each.dropped for each in rests)
    print(f"{len(names) * config.count} rests of {dropped} drops")


def _save(path: Path, mugs_sha256: str, rests: Mapping[str, Rests]) -> None:
    """Write rests by the names of mugs with that checksum, atomically."""
    with replacing(path) as temporary:
        np.savez_compressed(
            temporary,
            allow_pickle=False,
            names=np.array(list(rests)),
            mugs_sha256=np.array(mugs_sha256),
            X_TOs=np.stack([each.X_TOs for each in rests.values()]).astype(np.float32),
            dropped=np.array([each.dropped for each in rests.values()]),
        )


if __name__ == "__main__":
    run_command(lambda config: settle_split(config, Layout()), SettleConfig, __doc__)
