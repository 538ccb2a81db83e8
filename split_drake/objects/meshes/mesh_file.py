"""Meshes from files, in metres, and the reasons for which a file is of no use."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from split_drake.bad_input import BadInputError
from split_drake.objects.meshes.mass import fills_its_box, is_closed
from split_drake.poses import make_pose, rotation_x

SUFFIXES = (".obj", ".stl", ".ply", ".glb")
MIN_SIZE_M = 0.005
MAX_SIZE_M = 0.6
# What is thinner than this everywhere is a sheet.
_FLAT_M = 1e-4
_MIN_VOLUME_M3 = 1e-9
# Decimals of a metre to which vertices must agree to be one.
_MERGE_DIGITS = 9
# (4, 4): a turn by 90 degrees about x.
Y_UP_TO_Z_UP = make_pose(rotation_x(np.pi / 2.0)).round()


class ObjectFileError(BadInputError):
    """No usable object; one sentence: which file or folder, what is wrong, what was expected."""


def read_mesh(path: Path, scale: Sequence[float] = (1.0, 1.0, 1.0)) -> trimesh.Trimesh:
    """Return what a mesh file holds as one mesh, its parts as they are, stretched by `scale`.

    Raises ObjectFileError as `parse_mesh` does, and where the mesh has no volume, or is of no size
    that a hand's breadth would suggest.
    """
    mesh = parse_mesh(path)
    mesh = trimesh.Trimesh(mesh.vertices * np.asarray(scale), mesh.faces, process=False)
    if np.prod(scale) < 0.0:
        mesh.invert()
    _check_size(path, mesh)
    _check_volume(path, mesh)
    return mesh


def parse_mesh(path: Path) -> trimesh.Trimesh:
    """Return what a mesh file holds as one mesh, its parts as they are, in the file's units.

    glTF has y up by its standard; as in Drake, that turns to z up.

    Raises ObjectFileError where the file is missing or damaged, holds no faces, or NaN.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ObjectFileError(f"{path} is no mesh file; expected {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise ObjectFileError(f"{path} is missing; expected a mesh file")
    if not path.stat().st_size:
        raise ObjectFileError(f"{path} is an empty file; expected a mesh")
    mesh = _parse(path)
    if not len(mesh.faces):
        raise ObjectFileError(f"{path} holds no faces; expected a mesh")
    if not np.isfinite(mesh.vertices).all():
        raise ObjectFileError(f"{path} holds NaN or infinite vertices; expected finite ones")
    return mesh.apply_transform(Y_UP_TO_Z_UP) if path.suffix.lower() == ".glb" else mesh


def _parse(path: Path) -> trimesh.Trimesh:
    """Return the mesh of a file; raise ObjectFileError whatever its reader trips over."""
    try:
        mesh = trimesh.load_mesh(path, process=False)
        faces = np.asarray(mesh.faces).reshape(-1, 3)
        if faces.size and not 0 <= faces.min() <= faces.max() < len(mesh.vertices):
            raise ValueError(f"a face names vertex {faces.max()} of {len(mesh.vertices)}")
        return trimesh.Trimesh(mesh.vertices, faces, process=False)
    except Exception as error:
        raise ObjectFileError(
            f"{path} cannot be read ({_reason(error)}); expected a mesh as its suffix says"
        ) from error


def _reason(error: Exception) -> str:
    """Return what is wrong in one line."""
    # A damaged STL file is taken for text of an unknown coding, which asks for a library.
    if isinstance(error, (ImportError, AttributeError, MemoryError, KeyError)):
        return "its content is damaged"
    return " ".join(str(error).split())[:200] or type(error).__name__


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


def tidied(mesh: trimesh.Trimesh, digits: int = _MERGE_DIGITS) -> trimesh.Trimesh:
    """Return the mesh without colours, equal vertices merged, its faces turned outwards.

    Of faces with the same corners one is kept where they are not sides of a solid: meshes that are
    drawn from both sides have two.
    """
    tidy = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    tidy.merge_vertices(digits_vertex=digits)
    a, b, c = tidy.faces.T
    tidy.update_faces((a != b) & (b != c) & (c != a))
    # In a closed solid a sliver and its back may share corners, and either would leave a gap.
    if not (is_closed(tidy) and fills_its_box(tidy)):
        tidy.update_faces(_first_of_equal(tidy.faces))
    tidy.remove_unreferenced_vertices()
    if not len(tidy.faces):
        return tidy
    if not tidy.is_winding_consistent:
        trimesh.repair.fix_normals(tidy)
    elif tidy.volume < 0.0:
        tidy.invert()
    return tidy


def _first_of_equal(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (F,) whether no face before has the same corners, whichever way round."""
    kept = np.zeros(len(faces), dtype=bool)
    kept[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]] = True
    return kept
