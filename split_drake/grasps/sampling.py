"""Antipodal grasps of an object: sampled on its mesh, judged against it (paper section V)."""

from dataclasses import dataclass

import fpsample
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from split_drake.grasps.judge import (
    CONE_RAD,
    MIN_QUALITY,
    GraspCheck,
    GraspJudge,
    feasible,
    opening_for,
)
from split_drake.objects.ray_caster import RayCaster
from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, make_pose
from split_drake.robot.gripper import MAX_OPENING_M

__all__ = [
    "FalseGrasps",
    "GraspCheck",
    "GraspLabels",
    "check_grasps",
    "false_grasps",
    "feasible",
    "sample_grasps",
]

MIN_WIDTH_M = 0.0015
# Scans have walls as thin as this; their collision pieces are thick enough for the pads.
SCANNED_WIDTH_M = 0.0005
MAX_WIDTH_M = MAX_OPENING_M - 0.004
CANDIDATE_POINTS = 7000
CANDIDATE_TURNS = 6
# A line into a cup leaves material at the near wall, the far wall, and perhaps the handle.
EXITS = 3
# Pinches between this quality and MIN_QUALITY may hold in physics: they are not called false.
CLEARLY_WEAK = 0.3
# When grasps are thinned out, 4 cm of distance count as much as 1 rad between their approaches.
TURN_RAD_PER_M = 25.0


@dataclass(frozen=True)
class GraspLabels:
    """True grasps of an object in its frame O.

    Attributes:
        X_OGs: (N, 4, 4) grasps that hold, spread evenly over the object.
        openings_m: (N,) how far the pads are apart as the hand comes in.
        qualities: (N,) from MIN_QUALITY to 1, see `GraspJudge.qualities`.
        X_OGnegatives: (M, 4, 4) grasps that collide, pinch too little, or miss.
    """

    X_OGs: Array
    openings_m: Array
    qualities: Array
    X_OGnegatives: Array


def antipodal_lines(
    mesh: trimesh.Trimesh,
    count: int,
    rng: np.random.Generator,
    min_width_m: float,
    cone_rad: float = CONE_RAD,
) -> Array:
    """Return (N, 2, 3) ends of lines across material that start and end within friction cones.

    Lines start at `count` points spread over the surface, about along the normal; each of the
    first `EXITS` places where one leaves material gives a line.
    """
    p_OAs, faces = trimesh.sample.sample_surface(mesh, count, seed=int(rng.integers(2**31)))
    inward = -mesh.face_normals[faces] + rng.normal(0.0, 0.08, (count, 3))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    caster, step = RayCaster(mesh), 1e-4
    reached = np.zeros(count)
    lines = []
    for crossing in range(2 * EXITS - 1):
        distances, met = caster.cast(p_OAs + (reached + step)[:, None] * inward, inward)
        reached = reached + step + distances
        square = np.einsum("ni,ni->n", mesh.face_normals[met], inward) > np.cos(cone_rad)
        kept = (met >= 0) & square & (reached > min_width_m) & (reached < MAX_WIDTH_M)
        if crossing % 2 == 0:
            ends = p_OAs[kept] + reached[kept, None] * inward[kept]
            lines.append(np.stack([p_OAs[kept], ends], axis=1))
        reached = np.where(met >= 0, reached, 1.0)
    return np.concatenate(lines)


def antipodal_candidates(
    mesh: trimesh.Trimesh,
    count: int,
    turns: int,
    rng: np.random.Generator,
    min_width_m: float = MIN_WIDTH_M,
) -> tuple[Array, Array]:
    """Return grasps (N, 4, 4) whose pads' centres face each other across material, and widths."""
    return turned_about(antipodal_lines(mesh, count, rng, min_width_m), turns, rng)


def turned_about(lines: Array, turns: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return grasps (N * turns, 4, 4) across lines (N, 2, 3), turned about them anyhow, and widths.

    G lies in the middle of a line, its y along it.
    """
    lines = np.tile(lines, (turns, 1, 1))
    span = lines[:, 1] - lines[:, 0]
    widths = np.linalg.norm(span, axis=1)
    y = span / widths[:, None]
    z = np.cross(y, rng.normal(size=y.shape))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    R_OGs = np.stack([np.cross(y, z), y, z], axis=-1)
    return make_pose(R_OGs, lines.mean(axis=1)), widths


def _displaced(X_OGs: Array, rng: np.random.Generator) -> Array:
    """Return grasps moved by 2 cm and turned by half a radian or so: near misses."""
    shift = make_pose(p=rng.normal(0.0, 0.02, (len(X_OGs), 3)))
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.4, (len(X_OGs), 3))).as_matrix()
    return X_OGs @ shift @ make_pose(turn)


def spread_evenly(X_OGs: Array, count: int) -> np.ndarray:
    """Return the indices of at most `count` grasps, evenly spread over place and approach."""
    if len(X_OGs) <= count:
        return np.arange(len(X_OGs))
    features = np.column_stack([X_OGs[:, :3, 3] * TURN_RAD_PER_M, X_OGs[:, :3, 2]])
    return fpsample.bucket_fps_kdline_sampling(features, count, h=5, start_idx=0).astype(int)


def sample_grasps(
    body: RigidObject,
    rng: np.random.Generator,
    positives: int = 1500,
    negatives: int = 400,
    min_width_m: float = MIN_WIDTH_M,
) -> GraspLabels:
    """Return at most `positives` true grasps of an object and `negatives` false ones.

    Of the false ones a third each collide, hold badly, and are true ones displaced.  Grasps across
    less than `min_width_m` are left out.

    Raises ValueError where the object has no grasp.
    """
    judge = GraspJudge(body.mesh)
    X_OGs, widths = antipodal_candidates(
        body.mesh, CANDIDATE_POINTS, CANDIDATE_TURNS, rng, min_width_m
    )
    openings = opening_for(widths)
    qualities = judge.qualities(X_OGs, openings)
    firm = np.flatnonzero(qualities >= MIN_QUALITY)
    collides = judge.collides(X_OGs[firm], openings[firm])
    good = firm[~collides]
    if not len(good):
        raise ValueError(f"{body.name} has no grasp among {len(X_OGs)} candidates")
    chosen = good[spread_evenly(X_OGs[good], positives)]
    near = _displaced(X_OGs[rng.choice(chosen, negatives)], rng)
    third = negatives // 3
    false = [
        X_OGs[rng.permutation(firm[collides])[:third]],
        X_OGs[rng.permutation(np.flatnonzero(qualities < MIN_QUALITY))[:third]],
        near[~judge.check(near).good],
    ]
    return GraspLabels(
        X_OGs=X_OGs[chosen],
        openings_m=openings[chosen],
        qualities=qualities[chosen],
        X_OGnegatives=np.concatenate(false)[:negatives],
    )


@dataclass(frozen=True)
class FalseGrasps:
    """Grasps that fail wherever the object lies.

    Attributes:
        X_OGs: (N, 4, 4) grasps.
        openings_m: (N,) the opening that comes nearest to a grasp.
    """

    X_OGs: Array
    openings_m: Array


def false_grasps(
    body: RigidObject, X_OGtrues: Array, count: int, rng: np.random.Generator
) -> FalseGrasps:
    """Return at most `count` false grasps: about half displaced from true ones (N, 4, 4).

    The others have antipodal contacts; the hand collides, or pinches too little.
    """
    # Few are good, so that twice as many as are wanted suffice.
    antipodal, _ = antipodal_candidates(body.mesh, count, 1, rng)
    antipodal = antipodal[rng.permutation(len(antipodal))[:count]]
    near = _displaced(X_OGtrues[rng.integers(len(X_OGtrues), size=count)], rng)
    judge = GraspJudge(body.mesh)
    found: list[FalseGrasps] = []
    for X_OGs, wanted in ((near, count // 2), (antipodal, count - count // 2)):
        check = judge.check(X_OGs)
        false = np.flatnonzero(check.collides | (check.qualities < CLEARLY_WEAK))[:wanted]
        found.append(FalseGrasps(X_OGs[false], check.openings_m[false]))
    return FalseGrasps(
        np.concatenate([part.X_OGs for part in found]),
        np.concatenate([part.openings_m for part in found]),
    )


def check_grasps(body: RigidObject, X_OGs: Array) -> GraspCheck:
    """Return how any grasps (N, 4, 4), detected ones say, do geometrically."""
    return GraspJudge(body.mesh).check(X_OGs)
