"""Where the mass of a mesh lies: a solid where it is closed, a shell where it isn't."""

import numpy as np
import trimesh

from split_drake.poses import Array


def mass_properties(mesh: trimesh.Trimesh, mass_kg: float) -> tuple[Array, Array]:
    """Return centre of mass (3,) and inertia (3, 3) about it of a mesh that weighs `mass_kg`.

    Of uniform density where the mesh is closed, else a shell as heavy everywhere per area.
    """
    if is_closed(mesh):
        return np.asarray(mesh.center_mass), mesh.moment_inertia * (mass_kg / mesh.volume)
    masses = mass_kg * mesh.area_faces / mesh.area
    corners = mesh.triangles
    p_OCom = masses @ corners.mean(axis=1) / mass_kg
    offsets = corners - p_OCom
    # A triangle's second moment: a twelfth of those of its corners and of three times its centroid.
    sums = offsets.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", masses, offsets, offsets)
    second = (second + np.einsum("t,ti,tj->ij", masses, sums, sums)) / 12.0
    return p_OCom, np.trace(second) * np.eye(3) - second


def is_closed(mesh: trimesh.Trimesh) -> bool:
    """Return whether the faces pass every edge as often in one direction as in the other.

    That is what an integral over the volume needs.  Where a solid touches itself, as unions and
    scans do, four faces share an edge, and trimesh would not call it watertight.
    """
    count = len(mesh.vertices)
    directed = np.asarray(mesh.edges, dtype=np.int64) @ [[count, 1], [1, count]]
    return np.array_equal(*np.sort(directed, axis=0).T)
