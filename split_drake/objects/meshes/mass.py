"""Where the mass of a mesh lies: a solid where it is closed, a shell where it isn't."""

import numpy as np
import trimesh

from split_drake.poses import Array

# A solid fills more than this share of its bounding box.
_MIN_SHARE = 0.002


def mass_properties(mesh: trimesh.Trimesh, mass_kg: float) -> tuple[Array, Array]:
    """Return centre of mass (3,) and inertia (3, 3) about it of a mesh that weighs `mass_kg`.

    Of uniform density where the mesh is closed and encloses something, else a shell as heavy
    everywhere per area.
    """
    if is_closed(mesh) and _encloses_volume(mesh):
        return np.asarray(mesh.center_mass), mesh.moment_inertia * (mass_kg / mesh.volume)
    return shell_properties(mesh, mass_kg)


def shell_properties(mesh: trimesh.Trimesh, mass_kg: float) -> tuple[Array, Array]:
    """Return what `mass_properties` does, of a shell that is as heavy everywhere per area."""
    masses = mass_kg * mesh.area_faces / mesh.area
    corners = mesh.triangles
    p_OCom = masses @ corners.mean(axis=1) / mass_kg
    offsets = corners - p_OCom
    # A triangle's second moment: a twelfth of those of its corners and of three times its centroid.
    sums = offsets.sum(axis=1)
    second = np.einsum("t,tki,tkj->ij", masses, offsets, offsets)
    second = (second + np.einsum("t,ti,tj->ij", masses, sums, sums)) / 12.0
    return p_OCom, np.trace(second) * np.eye(3) - second


def _encloses_volume(mesh: trimesh.Trimesh) -> bool:
    """Return whether integrals over the volume make sense: a solid, whose mass lies within it.

    Surfaces drawn from both sides pass every edge both ways and enclose nothing.
    """
    if not (fills_its_box(mesh) and mesh.volume > 0.0):
        return False
    a, b, c = np.linalg.eigvalsh(mesh.moment_inertia)
    within = (mesh.center_mass >= mesh.bounds[0]) & (mesh.center_mass <= mesh.bounds[1])
    return bool(within.all() and a > 0.0 and c <= (a + b) * (1.0 + 1e-9))


def fills_its_box(mesh: trimesh.Trimesh) -> bool:
    """Return whether a closed mesh, its faces turned either way, encloses more than a film."""
    a, b, c = (mesh.triangles - mesh.bounds[0]).transpose(1, 0, 2)
    # trimesh's own volume comes with a centre of mass, which a film has none.
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0
    return bool(abs(volume) > _MIN_SHARE * np.prod(mesh.extents))


def is_closed(mesh: trimesh.Trimesh) -> bool:
    """Return whether the faces pass every edge as often in one direction as in the other.

    That is what an integral over the volume needs.  Where a solid touches itself, as unions and
    scans do, four faces share an edge, and trimesh would not call it watertight.
    """
    count = len(mesh.vertices)
    directed = np.asarray(mesh.edges, dtype=np.int64) @ [[count, 1], [1, count]]
    return np.array_equal(*np.sort(directed, axis=0).T)
