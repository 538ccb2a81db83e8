"""Try grasps of all mugs in physics: `python -m split_drake.grasps.check_grasps --mugs train`.

Antipodal candidates that pass the geometric judge, well spread over each mug, are tried one by one
in a free hand (`free_hand`), 0.2 s each: 50 minutes on two cores for the 30,000 of the training
mugs.  Each mug's outcomes are written when it is done; an interrupted run goes on where it was, and
one with more grasps a mug adds to what there is.
"""

import os
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.pools import LOCAL, make_pool, require_scheduler
from split_drake.grasps.free_hand import FreeHand
from split_drake.grasps.judge import MIN_QUALITY, GraspJudge, opening_for
from split_drake.grasps.sampling import antipodal_candidates, spread_evenly
from split_drake.grasps.store import CheckedGrasps, read_store, store_path, write_store
from split_drake.objects.rigid import RigidObject
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import usable_mugs
from split_drake.poses import Array
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

# The first candidates are spread over all good ones, which takes many from where a hand just fits;
# the others over those that a small error does not spoil.
WIDE = 80
STEADY = 70
MIN_STEADINESS = 0.7
# Among so many good grasps the steady ones are looked for.
SIFTED = 4000
POINTS = 7000
TURNS = 6


@dataclass(frozen=True)
class CheckConfig:
    """Which grasps to try.

    Attributes:
        mugs: to grasp, "train", "test", or a folder of meshes.
        per_mug: grasps of each, at most WIDE + STEADY.
        out: folder for the outcomes of single mugs.
        workers: processes; the outcomes do not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
    """

    mugs: str = "train"
    per_mug: int = WIDE + STEADY
    out: Path = Path("datasets/grasp_checks")
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL

    def __post_init__(self) -> None:
        require_numbers(self)
        if not 1 <= self.per_mug <= WIDE + STEADY:
            raise ValueError(f"per_mug is {self.per_mug}; expected 1 to {WIDE + STEADY}")
        MugSource(self.mugs)


def candidates(body: RigidObject, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return grasps (N, 4, 4) to try, openings and qualities (N,): `WIDE` ones, then `STEADY` ones.

    They are free of collisions and of at least MIN_QUALITY; where fewer are, there are fewer.
    """
    judge = GraspJudge(body.mesh)
    X_OGs, widths = antipodal_candidates(body.mesh, POINTS, TURNS, rng)
    openings = opening_for(widths)
    qualities = judge.qualities(X_OGs, openings)
    firm = np.flatnonzero(qualities >= MIN_QUALITY)
    good = firm[~judge.collides(X_OGs[firm], openings[firm])]
    wide = good[spread_evenly(X_OGs[good], WIDE)]
    sifted = rng.permutation(np.setdiff1d(good, wide))[:SIFTED]
    steadiness = judge.steadiness(X_OGs[sifted], openings[sifted], rng)
    steady = sifted[steadiness >= MIN_STEADINESS]
    chosen = np.concatenate([wide, steady[spread_evenly(X_OGs[steady], STEADY)]])
    return X_OGs[chosen], openings[chosen], qualities[chosen]


def check(
    body: RigidObject, rng: np.random.Generator, known: int, count: int, station: StationConfig
) -> CheckedGrasps:
    """Try the object's candidates from number `known` to `count`, in the contact of a station."""
    X_OGs, openings, qualities = (array[known:count] for array in candidates(body, rng))
    hand = FreeHand(body, station)
    holds = [hand.try_grasp(X_OG, opening) for X_OG, opening in zip(X_OGs, openings, strict=True)]
    return CheckedGrasps(
        X_OGs=X_OGs,
        openings_m=openings,
        qualities=qualities,
        faults=np.array([hold.fault for hold in holds], dtype="U8"),
        slips_m=np.array([hold.slip_m for hold in holds]),
        turns_rad=np.array([hold.turn_rad for hold in holds]),
    )


def _join(first: CheckedGrasps, second: CheckedGrasps) -> CheckedGrasps:
    return CheckedGrasps(
        **{
            f.name: np.concatenate([getattr(first, f.name), getattr(second, f.name)])
            for f in fields(CheckedGrasps)
        }
    )


def parts_folder(config: CheckConfig) -> Path:
    """Return the folder of the outcomes of single mugs."""
    source = MugSource(config.mugs)
    if source.folder is None:
        return config.out
    # Mugs of different folders may share a name.
    return config.out / source.derived_path("grasps").parent.name


def check_mug(source: MugSource, parts: Path, count: int, station: StationConfig, name: str) -> str:
    """Try what is missing of `count` grasps of a mug, write all atomically, and return its name."""
    path, sha256, mug = parts / f"{name}.npz", source.mugs_sha256(), source.load(name)
    before = read_store(path, sha256)[name] if path.exists() else None
    known = 0 if before is None else len(before)
    rng = np.random.default_rng(mug.seed)
    tried = check(mug.body, rng, known, count, station)
    grasps = tried if before is None else _join(before, tried)
    write_store(path, {name: grasps}, sha256)
    return name


def check_split(config: CheckConfig, station: StationConfig) -> None:
    """Try what is missing of all mugs, then write their store."""
    require_scheduler(config.scheduler)
    parts = parts_folder(config)
    parts.mkdir(parents=True, exist_ok=True)
    source = usable_mugs(MugSource(config.mugs), config.workers, Console()).source
    names, sha256 = source.names(), source.mugs_sha256()
    pool = make_pool(
        config.scheduler,
        config.workers,
        partial(check_mug, source, parts, config.per_mug, station),
        run=parts,
        kept=tuple(f"{name}.npz" for name in names),
    )
    for _ in track(pool.run(names), "mugs", total=len(names)):
        pass
    grasps = {name: read_store(parts / f"{name}.npz", sha256)[name] for name in names}
    write_store(store_path(config.mugs), grasps, sha256)
    faults = np.concatenate([checked.faults for checked in grasps.values()])
    for fault, count in zip(*np.unique(faults, return_counts=True), strict=True):
        print(f"{count / len(faults):6.1%}  {fault or 'holds'}")


if __name__ == "__main__":
    run_command(lambda config: check_split(config, StationConfig(Layout())), CheckConfig, __doc__)
