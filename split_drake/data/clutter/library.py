"""The objects of clutter scenes with their grasps, worked out once for each object and size.

``python -m split_drake.data.clutter.library --objects train --out FILE.npz`` keeps them.
Interrupted, the same command goes on.  A grasp is antipodal, pinches at most `MAX_WIDTH_M`, so that
a wide-open hand has room for its errors, and at least `LEAST_WIDTH_M`.  It is clear of its object
with the hand wide open, as the protocol has it come in.
"""

import os
from dataclasses import dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Literal, Self

import numpy as np
import shapely
import trimesh

from split_drake.bad_input import BadInputError, require_count
from split_drake.data.clutter.sizes import clutter_source
from split_drake.experiments.command import run_command
from split_drake.experiments.parts import Parts, parts_of
from split_drake.experiments.pool import InThisProcess, WorkerPool
from split_drake.experiments.provenance import code_version
from split_drake.files import interpreting, read_npz, replacing, split_rows
from split_drake.grasps.clutter_judge import CONE_RAD, LEAST_QUALITY, LEAST_WIDTH_M
from split_drake.grasps.judge import GraspJudge
from split_drake.grasps.lying import grasps_from_above, resting_poses
from split_drake.grasps.sampling import (
    MIN_WIDTH_M,
    antipodal_lines,
    false_grasps,
    spread_evenly,
    turned_about,
)
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import ObjectSource, TaskObject
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M

# Fingertips of a hand that opens by 80 mm land on what is wider than this when it is a little off.
MAX_WIDTH_M = 0.066
POINTS, TURNS = 1600, 4
# Of each way that an object comes to rest, so many grasps are tried that suit it.
PER_REST = 150
# Pads reach 11 mm beyond G: pinched nearer their tips, what lies flat is taken clear of the table.
MAX_BACK_M = 0.008
# Good grasps that are looked at for steadiness, and that are kept: of those turned anyhow, and of
# those from above.
SIFTED, KEPT, FALSE_KEPT = 250, 200, 60
# Of false ones, those across what is too thin.
THIN_KEPT = 40
SURFACE_POINTS = 400
_WHAT = "a library of grasps"
# From this quality on, a grasp's weight is that of its steadiness.
FULL_QUALITY = 0.6


@dataclass(frozen=True)
class ObjectGrasps:
    """Grasps of one object in its frame O.

    Attributes:
        X_OGs: (N, 4, 4) grasps that hold.
        weights: (N,) in (0, 1]: quality, up to `FULL_QUALITY`, times squared steadiness.
        X_OFs: (M, 4, 4) grasps that fail wherever the object lies.
    """

    X_OGs: Array
    weights: Array
    X_OFs: Array


NO_GRASPS = ObjectGrasps(np.empty((0, 4, 4)), np.empty(0), np.empty((0, 4, 4)))


def object_grasps(body: RigidObject, rng: np.random.Generator) -> ObjectGrasps:
    """Return grasps of an object for a hand that comes in wide open; none where none is good.

    Some false ones pinch what is too thin: it is all that tells them from good ones.
    """
    judge = GraspJudge(body.mesh, CONE_RAD)
    kinds = [_good(judge, X_OGs, rng) for X_OGs in _candidates(body, rng)]
    X_OGs = np.concatenate([X_OGs for X_OGs, _ in kinds])
    weights = np.concatenate([weights for _, weights in kinds])
    X_OFs = _too_thin(judge, body, rng)
    if len(X_OGs):
        X_OFs = np.concatenate([X_OFs, false_grasps(body, X_OGs, FALSE_KEPT, rng).X_OGs])
    return ObjectGrasps(X_OGs, weights, X_OFs)


def _good(judge: GraspJudge, X_OGs: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the steady ones of the grasps (N, 4, 4), spread out, and their weights."""
    wide = np.full(len(X_OGs), MAX_OPENING_M)
    qualities = judge.qualities(X_OGs, wide) if len(X_OGs) else np.zeros(0)
    firm = rng.permutation(np.flatnonzero(qualities >= LEAST_QUALITY))[: 3 * SIFTED]
    good = firm[~judge.collides(X_OGs[firm], wide[firm])][:SIFTED] if len(firm) else firm
    if len(good):
        good = good[judge.settled_widths(X_OGs[good], wide[good]) >= LEAST_WIDTH_M]
    if not len(good):
        return np.empty((0, 4, 4)), np.empty(0)
    steadiness = judge.steadiness(X_OGs[good], wide[good], rng, LEAST_QUALITY)
    steady = good[steadiness > 0.0]
    weights = np.minimum(1.0, qualities[good] / FULL_QUALITY) * steadiness**2
    kept = spread_evenly(X_OGs[steady], KEPT)
    return X_OGs[steady[kept]], weights[steadiness > 0.0][kept]


def _candidates(body: RigidObject, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return grasps (N, 4, 4) across antipodal lines: turned anyhow, and from above as it rests."""
    lines = _lines(body, LEAST_WIDTH_M, MAX_WIDTH_M, rng)
    return _turned_anyhow(lines, TURNS, rng), _from_above(lines, body, PER_REST, rng)


def _too_thin(judge: GraspJudge, body: RigidObject, rng: np.random.Generator) -> Array:
    """Return at most `THIN_KEPT` grasps (N, 4, 4) of both kinds whose pads close too far."""
    lines = rng.permutation(_lines(body, MIN_WIDTH_M, LEAST_WIDTH_M, rng))[:THIN_KEPT]
    both = [_turned_anyhow(lines, 1, rng), _from_above(lines, body, THIN_KEPT, rng)]
    X_OGs = rng.permutation(np.concatenate(both))[: 2 * THIN_KEPT]
    if not len(X_OGs):
        return X_OGs
    # Beside a thin place the pads may meet something thicker.
    widths_m = judge.settled_widths(X_OGs, np.full(len(X_OGs), MAX_OPENING_M))
    return X_OGs[widths_m < LEAST_WIDTH_M][:THIN_KEPT]


def _lines(body: RigidObject, least_m: float, most_m: float, rng: np.random.Generator) -> Array:
    """Return antipodal lines (N, 2, 3) of an object that are at least and at most so long."""
    lines = antipodal_lines(body.mesh, POINTS, rng, least_m, CONE_RAD)
    return lines[np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) <= most_m]


def _from_above(lines: Array, body: RigidObject, count: int, rng: np.random.Generator) -> Array:
    """Return grasps (N, 4, 4) across lines (M, 2, 3), at most so many of each way it rests."""
    resting = resting_poses(body.mesh, body.p_OCom)
    return np.concatenate([grasps_from_above(lines, X_TO, count, rng) for X_TO in resting])


def _turned_anyhow(lines: Array, turns: int, rng: np.random.Generator) -> Array:
    """Return grasps (N, 4, 4) across lines (M, 2, 3), each drawn back a little."""
    X_OGs, _ = turned_about(lines, turns, rng)
    return _drawn_back(X_OGs, rng)


def _drawn_back(X_OGs: Array, rng: np.random.Generator) -> Array:
    """Return the grasps (N, 4, 4), each up to `MAX_BACK_M` back along its approach."""
    back = X_OGs.copy()
    back[:, :3, 3] -= rng.uniform(0.0, MAX_BACK_M, (len(back), 1)) * back[:, :3, 2]
    return back


@dataclass(frozen=True)
class ClutterObject:
    """An object of clutter scenes.

    Attributes:
        shape: the object.
        grasps: of it.
    """

    shape: TaskObject
    grasps: ObjectGrasps

    @property
    def body(self) -> RigidObject:
        return self.shape.body

    @cached_property
    def triangles_O(self) -> Array:
        """(F, 3, 3): the mesh."""
        return np.asarray(self.body.mesh.triangles, dtype=np.float32)

    @cached_property
    def p_OSurface(self) -> Array:
        """(P, 3): points spread over its surface, which hands must keep clear of."""
        points, _ = trimesh.sample.sample_surface(self.body.mesh, SURFACE_POINTS, seed=0)
        return np.asarray(points, dtype=np.float32)

    @cached_property
    def footprint(self) -> shapely.Polygon:
        """What it covers as it stands, O's z up, about O's axis, metres."""
        return shapely.MultiPoint(self.body.mesh.vertices[:, :2]).convex_hull

    @cached_property
    def lowest_m(self) -> float:
        """The lowest z of its mesh in O."""
        return float(self.body.mesh.bounds[0, 2])


def _grasps_of(source: ObjectSource, name: str) -> tuple[str, ObjectGrasps]:
    shape = source.load(name)
    rng = np.random.default_rng([*shape.seed, 1])
    return name, object_grasps(shape.body, rng)


@dataclass(frozen=True)
class GraspLibrary:
    """Grasps of many objects.

    Attributes:
        source_sha256: of the source that the objects come from.
        grasps: {name of an object: its grasps}.
    """

    source_sha256: str
    grasps: dict[str, ObjectGrasps]

    @classmethod
    def work_out(cls, source: ObjectSource, workers: int, parts: Parts) -> Self:
        """Return the grasps of all objects of a source, half a second of CPU each.

        What is in `parts` is not worked out again, and each object's are put there.
        """
        names, sha256 = list(source.names()), source.sha256()
        work = partial(_grasps_of, source)
        pool = InThisProcess(work) if workers == 1 else WorkerPool(work, workers)

        def save(found: tuple[str, ObjectGrasps]) -> None:
            cls(sha256, dict([found])).save(parts.path(names.index(found[0])))

        parts.make(names, pool.run, save, "objects")
        loaded = [cls.load(parts.path(number), source) for number in range(len(names))]
        return cls(
            sha256, {name: each.grasps[name] for name, each in zip(names, loaded, strict=True)}
        )

    def save(self, path: Path) -> None:
        """Write the library, atomically."""
        arrays: dict[str, np.ndarray] = {
            "names": np.array(list(self.grasps)),
            "source_sha256": np.array(self.source_sha256),
        }
        for entry in fields(ObjectGrasps):
            parts = [getattr(each, entry.name) for each in self.grasps.values()]
            arrays[entry.name] = np.concatenate(parts).astype(np.float32)
            arrays[f"{entry.name}_counts"] = np.array([len(part) for part in parts])
        with replacing(path) as temporary:
            np.savez_compressed(temporary, allow_pickle=False, **arrays)

    @classmethod
    def load(cls, path: Path, source: ObjectSource) -> Self:
        """Return the library in a file; BadInputError where it is damaged or of other objects."""
        if not path.is_file():
            raise BadInputError(
                f"{path} does not exist; python -m split_drake.data.clutter.library makes it"
            )
        arrays = read_npz(path, _WHAT, required=("source_sha256", "names"))
        sha256 = str(arrays["source_sha256"])
        if sha256 != source.sha256():
            raise BadInputError(f"{path} holds grasps of other objects; make it anew")
        with interpreting(path, _WHAT):
            parts = {
                entry.name: split_rows(
                    arrays[entry.name].astype(float), arrays[f"{entry.name}_counts"], entry.name
                )
                for entry in fields(ObjectGrasps)
            }
            grasps = {
                str(name): ObjectGrasps(**{key: part[number] for key, part in parts.items()})
                for number, name in enumerate(arrays["names"])
            }
        return cls(sha256, grasps)


@dataclass(frozen=True)
class LibraryOptions:
    """Whose grasps to work out.

    Attributes:
        out: file.
        objects: split of the procedural objects.
        workers: processes, 1 for this one alone; the grasps do not depend on them.
    """

    out: Path
    objects: Literal["train", "test"] = "train"
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_count("workers", self.workers, 1)


def main(options: LibraryOptions) -> None:
    """Work out the grasps and write them."""
    source = clutter_source(options.objects)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    config = {"objects": options.objects, "source_sha256": source.sha256(), **code_version()}
    with parts_of(options.out, config) as parts:
        library = GraspLibrary.work_out(source, options.workers, parts)
        library.save(options.out)
    counts = np.array([len(each.X_OGs) for each in library.grasps.values()])
    median, none = np.median(counts), (counts == 0).sum()
    print(f"{len(counts)} objects, {median:.0f} grasps each (median), {none} without any")


if __name__ == "__main__":
    run_command(main, LibraryOptions, __doc__)
