"""Convex pieces of any mesh: as it is where it is made of such, else by CoACD, and kept in a cache.

CoACD: Wei et al., Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and
Tree Search, SIGGRAPH 2022.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import manifold3d
import numpy as np
import trimesh

from split_drake.files import read_npz, replacing, split_rows
from split_drake.objects.meshes.mass import is_closed
from split_drake.objects.meshes.mesh_file import ObjectFileError, tidied
from split_drake.poses import Array

# CoACD's concavity, here in metres, at which a piece is convex enough; a coarse search does.
SETTINGS: dict[str, float | bool] = {
    "threshold": 0.002,
    "real_metric": True,
    "max_convex_hull": 64,
    "mcts_iterations": 60,
    "mcts_nodes": 10,
    "mcts_max_depth": 2,
    "seed": 0,
}
# Vertices may lie this far outside the planes of the other faces.
_CONVEX_M = 2e-5
_MIN_VOLUME_M3 = 1e-10
_CHUNK = 1000


def convex_hulls(mesh: trimesh.Trimesh, cache: Path) -> list[Array]:
    """Return the vertices (N, 3) of convex pieces that stand for a mesh, metres.

    Args:
        cache: folder where decompositions are kept by what they were made of.

    Raises ObjectFileError where it cannot be decomposed.
    """
    parts = convex_parts(mesh)
    if parts is not None:
        return parts
    path = cache / f"{_sha256(mesh)}.npz"
    if (kept := _read(path)) is not None:
        return kept
    hulls = _decompose(mesh)
    with replacing(path) as temporary:
        counts = np.array([len(hull) for hull in hulls])
        np.savez_compressed(temporary, vertices=np.vstack(hulls), counts=counts, allow_pickle=False)
    return hulls


def convex_parts(mesh: trimesh.Trimesh) -> list[Array] | None:
    """Return the vertices (N, 3) of the closed convex parts of a mesh; None where one is none.

    Parts that touch are told apart by their own copies of vertices, where they have them.
    """
    for candidate in (mesh, tidied(mesh)):
        labels = trimesh.graph.connected_component_labels(
            candidate.face_adjacency, node_count=len(candidate.faces)
        )
        faces = [candidate.faces[labels == label] for label in range(labels.max() + 1)]
        parts = [trimesh.Trimesh(candidate.vertices, part, process=False) for part in faces]
        for part in parts:
            part.remove_unreferenced_vertices()
        if all(map(_is_convex, parts)):
            return [np.asarray(part.vertices) for part in parts]
    return None


def _is_convex(mesh: trimesh.Trimesh) -> bool:
    if len(mesh.faces) < 4 or not is_closed(mesh) or mesh.volume <= 0.0:
        return False
    # Neighbours are compared first: all faces with all vertices would be much of a dense scan.
    if mesh.face_adjacency_projections.max(initial=0.0) > _CONVEX_M:
        return False
    offsets = np.einsum("fi,fi->f", mesh.face_normals, mesh.triangles[:, 0])
    heights = (
        mesh.face_normals[at : at + _CHUNK] @ mesh.vertices.T - offsets[at : at + _CHUNK, None]
        for at in range(0, len(offsets), _CHUNK)
    )
    return all(height.max() < _CONVEX_M for height in heights)


def _sha256(mesh: trimesh.Trimesh) -> str:
    """Return a hash of the mesh and of how it is decomposed."""
    digest = hashlib.sha256(repr(sorted(SETTINGS.items())).encode())
    digest.update(np.ascontiguousarray(mesh.vertices, dtype=np.float64).tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype=np.int64).tobytes())
    return digest.hexdigest()


def _read(path: Path) -> list[Array] | None:
    """Return the hulls of a file; None where there is no whole one."""
    try:
        arrays = read_npz(path, "hulls", required=("vertices", "counts"))
        return split_rows(arrays["vertices"], arrays["counts"], "vertices")
    except ValueError:
        return None


def _decompose(mesh: trimesh.Trimesh) -> list[Array]:
    import coacd  # Slow to load, and needed for meshes that are new.

    coacd.set_log_level("error")
    tidy = tidied(mesh)
    parts: Sequence[tuple[Array, Array]]
    try:
        parts = coacd.run_coacd(coacd.Mesh(tidy.vertices, tidy.faces), **SETTINGS)
    except RuntimeError as error:
        raise ObjectFileError(f"the mesh cannot be decomposed ({error})") from error
    # Slivers, which no contact would be felt from, span too little to be pieces.
    hulls = [np.asarray(vertices, dtype=float) for vertices, _ in parts]
    hulls = [hull for hull in hulls if _volume_m3(hull) > _MIN_VOLUME_M3]
    if not hulls:
        raise ObjectFileError("the mesh cannot be decomposed: no piece is left; expected a solid")
    return hulls


def _volume_m3(p_OVs: Array) -> float:
    return float(manifold3d.Manifold.hull_points(p_OVs).volume())
