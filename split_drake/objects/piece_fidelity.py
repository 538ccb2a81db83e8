"""How well collision pieces stand for a mesh."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from split_drake.objects.convex_pieces import piece_mesh
from split_drake.objects.ray_caster import RayCaster
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array

Mask = NDArray[np.bool_]

_SAMPLES = 40_000
_NEAREST = 32
# Where a piece's face lies in the mesh's, which side of it a point is on would be chance.
_ON_M = 1e-5
# Directions along no axis, edge or face of usual shapes: inside is what most of them say.
_DIRECTIONS = np.array([[0.31, 0.54, 0.78], [-0.72, 0.43, -0.54], [0.65, -0.61, -0.46]])


@dataclass(frozen=True)
class Fidelity:
    """Distances between a mesh and the pieces that stand for it, metres.

    Attributes:
        uncovered_m: (N,) how far points of the mesh's surface lie outside all pieces; 0 inside.
        protruding_m: (M,) how far points of the pieces' surfaces lie outside the mesh; 0 inside.
    """

    uncovered_m: Array
    protruding_m: Array

    def share_within(self, distance_m: float) -> float:
        """Return the share of the mesh's points no further than `distance_m` from a piece."""
        return float(np.mean(self.uncovered_m <= distance_m))


def measure_fidelity(
    mesh: trimesh.Trimesh, pieces: Sequence[Primitive], count: int = 2000, seed: int = 0
) -> Fidelity:
    """Return how far `count` random points of the closed mesh, and of its pieces, lie apart."""
    hulls = [piece_mesh(piece) for piece in pieces]
    of_pieces = trimesh.util.concatenate(hulls)
    p_OMs = _sample(mesh, count, seed)[0]
    p_OQs, faces = _sample(of_pieces, count, seed)
    outside = ~np.any([_inside_convex(hull, p_OMs) for hull in hulls], axis=0)
    uncovered_m, protruding_m = np.zeros(count), np.zeros(count)
    uncovered_m[outside] = _distances(of_pieces, p_OMs[outside])
    beyond = ~_inside(mesh, p_OQs - _ON_M * of_pieces.face_normals[faces])
    protruding_m[beyond] = _distances(mesh, p_OQs[beyond])
    return Fidelity(uncovered_m, protruding_m)


def _sample(mesh: trimesh.Trimesh, count: int, seed: int) -> tuple[Array, Array]:
    """Return points (N, 3) of the surface and the faces (N,) that they lie on."""
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(points), np.asarray(faces)


def _inside_convex(hull: trimesh.Trimesh, p_OPs: Array) -> Mask:
    offsets = np.einsum("fi,fi->f", hull.face_normals, hull.triangles[:, 0])
    return np.asarray((p_OPs @ hull.face_normals.T <= offsets + _ON_M).all(axis=1))


def _inside(mesh: trimesh.Trimesh, p_OPs: Array) -> Mask:
    """Return (N,) whether points lie inside: rays from there meet a face's back first."""
    caster, votes = RayCaster(mesh), np.zeros(len(p_OPs))
    for direction in _DIRECTIONS:
        _, faces = caster.cast(p_OPs, np.broadcast_to(direction, p_OPs.shape))
        votes += (faces >= 0) & (mesh.face_normals[faces] @ direction > 0.0)
    return np.asarray(votes > len(_DIRECTIONS) / 2.0)


def _distances(mesh: trimesh.Trimesh, p_OPs: Array) -> Array:
    """Return (N,) distances of points to the surface: to the faces of the nearest samples."""
    if not len(p_OPs):
        return np.zeros(0)
    samples, faces = _sample(mesh, _SAMPLES, seed=1)
    nearest = cKDTree(samples).query(p_OPs, k=_NEAREST)[1]
    triangles = mesh.triangles[faces[nearest.ravel()]]
    repeated = np.repeat(p_OPs, _NEAREST, axis=0)
    closest = trimesh.triangles.closest_point(triangles, repeated)
    apart = np.linalg.norm(closest - repeated, axis=1)
    return np.asarray(apart.reshape(len(p_OPs), _NEAREST).min(axis=1))
