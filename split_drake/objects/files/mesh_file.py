"""Meshes from files, in metres, and the reasons for which a file is of no use."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from split_drake.bad_input import BadInputError

SUFFIXES = (".obj", ".stl", ".ply", ".glb")
MIN_SIZE_M = 0.005
MAX_SIZE_M = 0.6
# What is thinner than this everywhere is a sheet.
_FLAT_M = 1e-4
_MIN_VOLUME_M3 = 1e-9
# Decimals of a metre to which vertices must agree to be one.
_MERGE_DIGITS = 9


class ObjectFileError(BadInputError):
    """No usable object; one sentence: which file or folder, what is wrong, what was expected."""


def read_mesh(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> trimesh.Trimesh:
    """Return what a mesh file holds as one mesh, its parts as they are, stretched by `scale`.

    Raises ObjectFileError where it cannot be read, is empty, holds NaN, has no volume, or is of no
    size that a hand's breadth would suggest.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ObjectFileError(f"{path} is no mesh file; expected {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise ObjectFileError(f"{path} is missing; expected a mesh file")
    mesh = _parse(path)
    if not len(mesh.faces):
        raise ObjectFileError(f"{path} holds no faces; expected a mesh")
    if not np.isfinite(mesh.vertices).all():
        raise ObjectFileError(f"{path} holds NaN or infinite vertices; expected finite ones")
    mesh = trimesh.Trimesh(mesh.vertices * np.asarray(scale), mesh.faces, process=False)
    if np.prod(scale) < 0.0:
        mesh.invert()
    _check_size(path, mesh)
    _check_volume(path, mesh)
    return mesh


def _parse(path: Path) -> trimesh.Trimesh:
    if not path.stat().st_size:
        raise ObjectFileError(f"{path} is an empty file; expected a mesh")
    try:
        return trimesh.load_mesh(path, process=False)
    # Readers of foreign files raise whatever they trip over.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ObjectFileError(
            f"{path} cannot be read ({reason}); expected a mesh as its suffix says"
        ) from error


def _check_size(path: Path, mesh: trimesh.Trimesh) -> None:
    size_m = float(mesh.extents.max())
    if not MIN_SIZE_M <= size_m <= MAX_SIZE_M:
        units = "millimetres" if size_m > MAX_SIZE_M else "metres"
        raise ObjectFileError(
            f"{path} measures {size_m:.4g} m along its longest edge; expected {MIN_SIZE_M:g} to "
            f"{MAX_SIZE_M:g} m (are its units {units}?)"
        )


def _check_volume(path: Path, mesh: trimesh.Trimesh) -> None:
    if _spans_no_volume(mesh):
        raise ObjectFileError(f"{path} has no volume; expected a solid, not a sheet")


def _spans_no_volume(mesh: trimesh.Trimesh) -> bool:
    offsets = mesh.vertices - mesh.vertices.mean(axis=0)
    across = np.linalg.svd(offsets, full_matrices=False)[2][-1]
    if np.ptp(offsets @ across) < _FLAT_M:
        return True
    return bool(mesh.is_watertight and abs(mesh.volume) < _MIN_VOLUME_M3)


def tidied(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh without colours, equal vertices merged, its faces turned outwards."""
    tidy = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    tidy.merge_vertices(digits_vertex=_MERGE_DIGITS)
    a, b, c = tidy.faces.T
    tidy.update_faces((a != b) & (b != c) & (c != a))
    tidy.remove_unreferenced_vertices()
    if not tidy.is_winding_consistent:
        trimesh.repair.fix_normals(tidy)
    elif tidy.volume < 0.0:
        tidy.invert()
    return tidy
