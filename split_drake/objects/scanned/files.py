"""Mugs from mesh files: any upright mug in metres, brought into its frame O and made a body of."""

from collections import Counter
from pathlib import Path

import numpy as np
import shapely
import trimesh

from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.rigid import RigidObject
from split_drake.objects.scanned.collision import fit_collision
from split_drake.objects.scanned.frame import find_frame, into_frame
from split_drake.objects.scanned.handle import (
    PEG_ROOM_M,
    Silhouette,
    cast_outline,
    measure_grip,
    see_through,
)
from split_drake.objects.scanned.mass import mass_properties
from split_drake.objects.scanned.profile import measure_profile
from split_drake.poses import Array, make_pose

SUFFIXES = (".obj", ".stl", ".ply", ".glb")
MASS_KG = 0.30
MIN_SIZE_M = 0.02
# A workspace of 30 cm holds a mug of this size up to 3 cm off its middle.
MAX_SIZE_M = 0.24
# Decimals of a metre to which vertices must agree to be one.
_MERGE_DIGITS = 12
# Points this close to the table count as what a mug stands on.
_FOOT_M = 0.002


def load_mug_folder(folder: Path) -> tuple[MugShape, ...]:
    """Return the mugs of a folder of mesh files, or of folders holding one each, sorted by name.

    Raises as `mug_files` does, and InvalidMugError, naming the file, where a mesh is no mug.
    """
    return tuple(load_mug_file(path, name) for name, path in mug_files(folder).items())


def mug_files(folder: Path) -> dict[str, Path]:
    """Return {name: mesh file} of a folder of mesh files, or of folders holding one each, sorted.

    A mug is called as its file, or as the folder that holds it.

    Raises FileNotFoundError where there is no mesh file, and ValueError where a folder holds
    several or two mugs have one name.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}; expected one of mesh files")
    named = [(path.stem, path) for path in _mesh_files(folder)]
    for inner in (path for path in folder.iterdir() if path.is_dir()):
        meshes = _mesh_files(inner)
        if len(meshes) > 1:
            raise ValueError(f"{inner} holds {len(meshes)} mesh files; expected one mug a folder")
        named += [(inner.name, path) for path in meshes]
    if not named:
        raise FileNotFoundError(f"{folder} holds no mesh file; expected {', '.join(SUFFIXES)}")
    name, count = Counter(name for name, _ in named).most_common(1)[0]
    if count > 1:
        raise ValueError(f"{count} mugs in {folder} are called {name!r}; expected different names")
    return dict(sorted(named))


def _mesh_files(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]


def load_mug_file(path: Path, name: str | None = None) -> MugShape:
    """Return the mug of a mesh file, called `name` or else as the file.

    The file holds one mug, upright (z up) and in metres, wherever it stands and whichever way its
    handle points.  Gaps and inner surfaces do no harm as long as rays meet body and handle.

    Raises FileNotFoundError, or InvalidMugError where the mesh is no mug: the file, the reason,
    and the numbers.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file; expected a mesh of a mug")
    try:
        return build_mug_from_mesh(path.stem if name is None else name, _read_mesh(path))
    except InvalidMugError as error:
        raise InvalidMugError(f"{path}: {error}") from error


def _read_mesh(path: Path) -> trimesh.Trimesh:
    """Return what the file holds as one mesh, whatever its parts."""
    if path.suffix.lower() not in SUFFIXES:
        raise InvalidMugError(f"unknown kind of file; expected {', '.join(SUFFIXES)}")
    if not path.stat().st_size:
        raise InvalidMugError("empty file")
    try:
        return trimesh.load_mesh(path, process=False)
    except ValueError as error:
        raise InvalidMugError(f"unreadable file: {error}") from error


def build_mug_from_mesh(name: str, mesh_F: trimesh.Trimesh) -> MugShape:
    """Return the mug whose mesh, in a frame F with z up, is given in metres.

    Raises InvalidMugError where the mesh is no mug: the reason, a colon, and the numbers.
    """
    mesh = _tidy(mesh_F)
    _check_size(mesh)
    mesh = into_frame(mesh, find_frame(mesh))
    profile = measure_profile(mesh)
    silhouette = see_through(mesh)
    opening_OPs = cast_outline(mesh, silhouette.p_OMiddle())
    p_OCom, inertia = mass_properties(mesh, MASS_KG)
    _check_stands(mesh, p_OCom)
    body = RigidObject(
        name=name,
        mesh=mesh,
        mass_kg=MASS_KG,
        p_OCom=p_OCom,
        inertia_kg_m2=inertia,
        collision=fit_collision(profile, measure_grip(mesh, silhouette, profile)),
    )
    diameter = 2.0 * float(profile.outer_m.max())
    return MugShape.of(body, _handle_pose(opening_OPs, silhouette), opening_OPs, diameter)


def _tidy(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh without colours, equal vertices merged, its faces turned outwards."""
    tidy = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    # Vertices that are only close, and slivers, stay: without them the mesh could leak.
    tidy.merge_vertices(digits_vertex=_MERGE_DIGITS)
    a, b, c = tidy.faces.T
    tidy.update_faces((a != b) & (b != c) & (c != a))
    tidy.remove_unreferenced_vertices()
    if not len(tidy.faces):
        raise InvalidMugError("empty mesh: it has no faces")
    if not tidy.is_winding_consistent:
        trimesh.repair.fix_normals(tidy)
    elif tidy.volume < 0.0:
        tidy.invert()
    return tidy


def _check_size(mesh: trimesh.Trimesh) -> None:
    size = float(mesh.extents.max())
    if not MIN_SIZE_M <= size <= MAX_SIZE_M:
        raise InvalidMugError(
            f"wrong size: it measures {size:.4g} m along its longest edge, expected {MIN_SIZE_M:g} "
            f"to {MAX_SIZE_M:g} m; are its units metres?"
        )


def _check_stands(mesh: trimesh.Trimesh, p_OCom: Array) -> None:
    foot = mesh.vertices[mesh.vertices[:, 2] < _FOOT_M, :2]
    support = shapely.MultiPoint(foot).convex_hull
    outside_m = support.distance(shapely.Point(p_OCom[:2]))
    if outside_m > 0.0:
        raise InvalidMugError(
            f"cannot stand: its centre of mass lies {outside_m:.4f} m beside what it stands on"
        )


def _handle_pose(opening_OPs: Array, silhouette: Silhouette) -> Array:
    """Return X_OH, parallel to O with its origin at the centroid of the opening's outline."""
    center = shapely.Polygon(opening_OPs[:, [0, 2]]).centroid
    room_m = silhouette.room_m(np.array([center.x, center.y]))
    if room_m < PEG_ROOM_M:
        raise InvalidMugError(
            f"tight opening: {room_m:.4f} m of room around its centroid, expected {PEG_ROOM_M}"
        )
    return make_pose(p=(center.x, 0.0, center.y))
