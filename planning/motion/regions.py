"""Regions: convex sets of arm configurations, free of the static station, grown once and kept.

IRIS-ZO (P. Werner et al., "Faster Algorithms for Growing Collision-Free Convex Polytopes in Robot
Configuration Space", 2024) inflates a polytope around each seed.  A region is free but for a small
share of its volume, and knows neither the object nor how far the hand is open: what runs through
regions must be checked.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.common import Parallelism
from pydrake.geometry.optimization import HPolyhedron, Hyperellipsoid
from pydrake.planning import (
    CommonSampledIrisOptions,
    IrisParameterizationFunction,
    IrisZo,
    IrisZoOptions,
)
from pydrake.symbolic import Expression, MakeVectorVariable

from planning.collision.world import CollisionWorld
from split_drake.files import (
    UnreadableFileError,
    interpreting,
    read_npz,
    replacing,
    split_rows,
)
from split_drake.models_folder import MODELS_FOLDER
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import LIMIT_MARGIN_RAD
from split_drake.robot.panda import arm_limits
from split_drake.station.layout import Layout
from split_drake.station.layout_file import layout_from_json, layout_to_json

SHIPPED_REGIONS = MODELS_FOLDER / "regions" / "station.npz"
FORMAT = 1
_WHAT = "a file of regions"
# At most this share of a region's volume is in collision, but for a chance of 5%.
COLLIDING_SHARE = 0.01
PARTICLES = 500
SEED_RADIUS_RAD = 0.05
# A seed is taken where most uncovered configurations lie within this distance.
NEIGHBOURHOOD_RAD = 1.0


@dataclass(frozen=True)
class Regions:
    """Convex sets of arm configurations in the free space of a static station.

    Attributes:
        layout: of the station.
        polytopes: the sets, each in 7 joint angles, rad.
        edges: pairs (from, to) of polytopes that intersect.
    """

    layout: Layout
    polytopes: tuple[HPolyhedron, ...]
    edges: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        return len(self.polytopes)

    def covers(self, qs: Array) -> NDArray[np.bool_]:
        """Return (N,): whether each of the configurations (N, 7) lies in a region."""
        return np.array([any(p.PointInSet(q) for p in self.polytopes) for q in qs], dtype=bool)


def grow_regions(world: CollisionWorld, qs: Array, max_regions: int, seed: int) -> Regions:
    """Return regions that cover configurations (N, 7), as many of them as `max_regions` reach.

    Args:
        world: its static station and robot are what regions keep clear of.
        qs: free configurations, rad; the first is the first seed.
        max_regions: how many to grow at most.
        seed: of the sampling.
    """
    polytopes = [_grown(world, qs[0], seed)]
    left = qs[~_inside(polytopes[0], qs)]
    while len(left) and len(polytopes) < max_regions:
        crowd = (np.linalg.norm(left[:, None] - left, axis=-1) < NEIGHBOURHOOD_RAD).sum(axis=1)
        densest = int(np.argmax(crowd))
        polytopes.append(_grown(world, left[densest], seed + len(polytopes)))
        covered = _inside(polytopes[-1], left)
        covered[densest] = True
        left = left[~covered]
    return Regions(world.layout, tuple(polytopes), _overlaps(polytopes))


def _inside(polytope: HPolyhedron, qs: Array) -> NDArray[np.bool_]:
    return np.asarray((qs @ polytope.A().T <= polytope.b()).all(axis=1))


def _overlaps(polytopes: Sequence[HPolyhedron]) -> tuple[tuple[int, int], ...]:
    pairs = permutations(range(len(polytopes)), 2)
    return tuple((i, j) for i, j in pairs if polytopes[i].IntersectsWith(polytopes[j]))


def _grown(world: CollisionWorld, q: Array, seed: int) -> HPolyhedron:
    """Return a region around the free configuration `q` (7,), with the hand wide open."""
    limits = arm_limits()
    domain = HPolyhedron.MakeBox(
        limits.q_lower + LIMIT_MARGIN_RAD / 2.0, limits.q_upper - LIMIT_MARGIN_RAD / 2.0
    )
    options = IrisZoOptions()
    options.parameterization = _open_hand()
    sampling: CommonSampledIrisOptions = options.sampled_iris_options
    sampling.num_particles = PARTICLES
    sampling.epsilon = COLLIDING_SHARE
    sampling.max_iterations = 1
    sampling.random_seed = seed
    sampling.parallelism = Parallelism(1)
    ball = Hyperellipsoid.MakeHypersphere(SEED_RADIUS_RAD, q)
    return IrisZo(world.free_motion_checker, ball, domain, options).ReduceInequalities()


def _open_hand() -> IrisParameterizationFunction:
    """Return the positions of arm and open fingers as a function of the arm's."""
    arm = MakeVectorVariable(7, "q")
    finger = Expression(MAX_OPENING_M / 2.0)
    return IrisParameterizationFunction(np.array([*arm, finger, finger]), arm)


def save_regions(path: Path, regions: Regions) -> None:
    """Write regions as an npz, atomically."""
    faces = [len(p.b()) for p in regions.polytopes]
    with replacing(path) as temporary:
        np.savez_compressed(
            temporary,
            allow_pickle=False,
            format=np.array(FORMAT),
            layout=np.array(layout_to_json(regions.layout)),
            A=np.concatenate([p.A() for p in regions.polytopes]),
            b=np.concatenate([p.b() for p in regions.polytopes]),
            faces=np.array(faces),
            edges=np.array(regions.edges, dtype=int).reshape(-1, 2),
        )


def load_regions(path: Path = SHIPPED_REGIONS) -> Regions:
    """Return regions as written by `save_regions`.

    Raises MissingFileError, and UnreadableFileError where the file is damaged or of another format.
    """
    arrays = read_npz(path, _WHAT)
    if (found := arrays.get("format", np.array(None)).tolist()) != FORMAT:
        raise UnreadableFileError(f"{path} has format {found}; expected {FORMAT}")
    with interpreting(path, _WHAT):
        As, bs = (split_rows(arrays[key], arrays["faces"], key) for key in ("A", "b"))
        polytopes = tuple(_polytope(A, b) for A, b in zip(As, bs, strict=True))
        edges = tuple((int(i), int(j)) for i, j in arrays["edges"])
        if not all(0 <= number < len(polytopes) for edge in edges for number in edge):
            raise ValueError(f"an edge leads to none of the {len(polytopes)} regions")
        return Regions(layout_from_json(str(arrays["layout"])), polytopes, edges)


def _polytope(A: Array, b: Array) -> HPolyhedron:
    """Return {q: A q <= b}; ValueError where that is no set of arm configurations."""
    if A.ndim != 2 or A.shape[1] != 7 or not (np.isfinite(A).all() and np.isfinite(b).all()):
        raise ValueError(f"faces have shape {A.shape}; expected (F, 7) finite numbers")
    return HPolyhedron(A, b)
