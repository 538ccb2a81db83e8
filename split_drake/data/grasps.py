"""Antipodal grasps of a mug: sampled on its mesh, judged against hand, mug and table.

Follows the paper's section V: antipodal sampling at the object's level; in a scene the hand must
clear the table and approach within 90 degrees of straight down.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from split_drake.data.render import RayCaster
from split_drake.gripper import MAX_OPENING_M, PAD_SIZE_M, Box, gripper_boxes
from split_drake.objects import MugShape
from split_drake.poses import Array, invert_pose, make_pose, transform_points

# Half-angle of the friction cone that contacts must lie in; physics has arctan(0.8) = 0.67 rad.
CONE_RAD = 0.3
# Room left between each pad and the object as the hand comes in.
SIDE_ROOM_M = 0.012
MIN_QUALITY = 0.2
# Curved walls leave the corners of a pad free; this share of its face is as good as it gets.
FULL_SHARE = 0.7
BEARING_DEPTH_M = 0.0015
MIN_WIDTH_M = 0.0015
CANDIDATE_POINTS = 8000
CANDIDATE_TURNS = 6
# Collisions are looked for in at most this many of the candidates that pinch firmly.
CHECKED_CANDIDATES = 5000
TABLE_CLEARANCE_M = 0.002
SURFACE_POINTS = 2000
APPROACH_M = 0.06

_PAD_X, _PAD_Z = (
    grid.ravel()
    for grid in np.meshgrid(
        np.linspace(-0.4, 0.4, 5) * PAD_SIZE_M[0], np.linspace(-0.45, 0.45, 7) * PAD_SIZE_M[1]
    )
)


@dataclass(frozen=True)
class GraspLabels:
    """True grasps of a mug in its frame O.

    Attributes:
        X_OGs: (N, 4, 4) grasps that hold.
        openings_m: (N,) how far the pads are apart as the hand comes in.
        qualities: (N,) in (0, 1]: the share of each pad's face that meets material squarely.
        X_OGnegatives: (M, 4, 4) grasps that collide, pinch too little, or miss.
    """

    X_OGs: Array
    openings_m: Array
    qualities: Array
    X_OGnegatives: Array


@dataclass(frozen=True)
class GraspCheck:
    """How grasps (N) of a mug fare geometrically.

    Attributes:
        qualities: (N,) see GraspLabels; 0 where the pads miss.
        openings_m: (N,) that the hand comes in with.
        collides: (N,) whether the opened hand hits the mug, at the grasp or on its way there.
    """

    qualities: Array
    openings_m: Array
    collides: NDArray[np.bool_]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(N,): whether a grasp holds and can be reached."""
        return (self.qualities >= MIN_QUALITY) & ~self.collides


@dataclass(frozen=True)
class Pinch:
    """What the pads of grasps (N) close on.

    Attributes:
        qualities: (N,) see GraspLabels.
        widths_m: (N,) between the pads once closed.
    """

    qualities: Array
    widths_m: Array

    @property
    def firm(self) -> NDArray[np.bool_]:
        """(N,): whether enough of both pads bears."""
        return self.qualities >= MIN_QUALITY


class GraspJudge:
    """Judges grasps of one mesh."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._mesh = mesh
        self._caster = RayCaster(mesh)
        self._p_OSurface, _ = trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)

    def check(self, X_OGs: Array) -> GraspCheck:
        """Return how grasps (N, 4, 4) in O fare."""
        pinch = self.pinch(X_OGs)
        openings = np.clip(pinch.widths_m + 2.0 * SIDE_ROOM_M, 0.0, MAX_OPENING_M)
        return GraspCheck(pinch.qualities, openings, self._collides(X_OGs, openings))

    def pinch(self, X_OGs: Array) -> Pinch:
        """Return what the pads of grasps (N, 4, 4) in O close on."""
        near, near_square = self._first_contacts(X_OGs, 1.0)
        far, far_square = self._first_contacts(X_OGs, -1.0)
        # A flat pad stops at the outermost point; lines that end close behind it carry the force.
        bears_near = near_square & (near < near.min(axis=1, keepdims=True) + BEARING_DEPTH_M)
        bears_far = far_square & (far < far.min(axis=1, keepdims=True) + BEARING_DEPTH_M)
        share = np.minimum(bears_near.mean(axis=1), bears_far.mean(axis=1))
        widths = MAX_OPENING_M - near.min(axis=1) - far.min(axis=1)
        meets = np.isfinite(widths) & (widths > MIN_WIDTH_M)
        qualities = np.where(meets, np.minimum(1.0, share / FULL_SHARE), 0.0)
        return Pinch(qualities, np.where(meets, widths, 0.0))

    def _first_contacts(self, X_OGs: Array, side: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return, for lines over a pad's face, (N, L) how far they go, and whether they hit square.

        The lines start at the face of the fully opened pad at y = side * 4 cm, and run inwards.
        """
        starts = np.column_stack([_PAD_X, np.full_like(_PAD_X, side * MAX_OPENING_M / 2), _PAD_Z])
        origins = transform_points(X_OGs, starts)
        inward = np.repeat(-side * X_OGs[:, None, :3, 1], len(starts), axis=1)
        distances, faces = self._caster.cast(origins.reshape(-1, 3), inward.reshape(-1, 3))
        normals = self._mesh.face_normals[faces]
        square = np.einsum("ni,ni->n", normals, -inward.reshape(-1, 3)) > np.cos(CONE_RAD)
        shape = (len(X_OGs), len(starts))
        within = (distances < MAX_OPENING_M).reshape(shape)
        return np.where(within, distances.reshape(shape), np.inf), square.reshape(shape) & within

    def _collides(self, X_OGs: Array, openings_m: Array) -> NDArray[np.bool_]:
        """Return (N,): whether the hand, or its way in along z_G, holds a point of the surface."""
        hits = np.zeros(len(X_OGs), dtype=bool)
        p_OPs = self._p_OSurface.astype(np.float32)
        X_GOs = invert_pose(X_OGs).astype(np.float32)
        for chosen, boxes in _hands(openings_m):
            for part in np.array_split(chosen, len(chosen) // 200 + 1):
                p_GPs = p_OPs @ X_GOs[part, :3, :3].swapaxes(1, 2) + X_GOs[part, None, :3, 3]
                x, y, z = np.moveaxis(p_GPs, 2, 0)
                for box in boxes:
                    (_, y0, z0), (x1, y1, z1) = box.lower, box.upper
                    inside = (np.abs(x) < x1) & (y > y0) & (y < y1)
                    inside &= (z > z0 - APPROACH_M) & (z < z1)
                    hits[part] |= inside.any(axis=1)
        return hits


def _hands(openings_m: Array) -> Iterator[tuple[NDArray[np.int_], tuple[Box, ...]]]:
    """Yield the grasps of about equal openings, to 2 mm, and the boxes of a hand so opened."""
    bins = np.minimum(np.ceil(openings_m * 500.0) / 500.0, MAX_OPENING_M)
    for opening_m in np.unique(bins):
        yield np.flatnonzero(bins == opening_m), gripper_boxes(float(opening_m))


def feasible(X_WO: Array, X_OGs: Array, openings_m: Array) -> NDArray[np.bool_]:
    """Return (N,): whether the hand clears the table and comes from above, the object at X_WO.

    The approach must be within 90 degrees of straight down (paper section V).
    """
    X_WGs = X_WO @ X_OGs
    lowest = np.full(len(X_WGs), np.inf)
    for chosen, boxes in _hands(openings_m):
        corners = np.concatenate([trimesh.bounds.corners([b.lower, b.upper]) for b in boxes])
        lowest[chosen] = transform_points(X_WGs[chosen], corners)[..., 2].min(axis=1)
    return (lowest > TABLE_CLEARANCE_M) & (X_WGs[:, 2, 2] < 0.0)


def _candidates(mesh: trimesh.Trimesh, count: int, turns: int, rng: np.random.Generator) -> Array:
    """Return grasps (N, 4, 4) whose pads' centres face each other across material."""
    p_OAs, faces = trimesh.sample.sample_surface(mesh, count, seed=int(rng.integers(2**31)))
    inward = -mesh.face_normals[faces] + rng.normal(0.0, 0.08, (count, 3))
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    reached, met = RayCaster(mesh).cast(p_OAs + 1e-4 * inward, inward)
    square = np.einsum("ni,ni->n", mesh.face_normals[met], inward) > np.cos(CONE_RAD)
    kept = (met >= 0) & square & (reached < MAX_OPENING_M - 0.004)
    y = np.tile(inward[kept], (turns, 1))
    centers = np.tile(p_OAs[kept] + 0.5 * reached[kept, None] * inward[kept], (turns, 1))
    z = np.cross(y, rng.normal(size=y.shape))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return make_pose(np.stack([np.cross(y, z), y, z], axis=-1), centers)


def _displaced(X_OGs: Array, rng: np.random.Generator) -> Array:
    """Return grasps moved by 2 cm and turned by half a radian or so: near misses."""
    shift = make_pose(p=rng.normal(0.0, 0.02, (len(X_OGs), 3)))
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.4, (len(X_OGs), 3))).as_matrix()
    return X_OGs @ shift @ make_pose(turn)


def sample_grasps(
    mug: MugShape,
    rng: np.random.Generator,
    positives: int = 1500,
    negatives: int = 400,
) -> GraspLabels:
    """Return at most `positives` true grasps of a mug and `negatives` false ones."""
    mesh = mug.body.mesh
    judge = GraspJudge(mesh)
    X_OGs = _candidates(mesh, CANDIDATE_POINTS, CANDIDATE_TURNS, rng)
    firm = judge.pinch(X_OGs).firm
    X_OFirms = rng.permutation(X_OGs[firm])[:CHECKED_CANDIDATES]
    check = judge.check(X_OFirms)
    good = rng.permutation(np.flatnonzero(check.good))[:positives]
    if not len(good):
        raise ValueError(f"{mug.body.name} has no grasp among {len(X_OGs)} candidates")
    chosen = X_OFirms[good]
    near = _displaced(chosen[rng.integers(len(good), size=negatives)], rng)
    false = [
        X_OFirms[check.collides][: negatives // 3],
        X_OGs[~firm][: negatives // 3],
        near[~judge.check(near).good],
    ]
    return GraspLabels(
        X_OGs=chosen,
        openings_m=check.openings_m[good],
        qualities=check.qualities[good],
        X_OGnegatives=np.concatenate(false)[:negatives],
    )


def check_grasps(mug: MugShape, X_OGs: Array) -> GraspCheck:
    """Return how any grasps (N, 4, 4) of a mug, detected ones say, fare geometrically."""
    return GraspJudge(mug.body.mesh).check(X_OGs)
