"""Folders of objects: URDF files with their meshes, or plain mesh files."""

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import trimesh

from split_drake.bad_input import require_numbers
from split_drake.experiments.provenance import combined_sha256, file_sha256
from split_drake.objects.convex_pieces import pieces_that_rest
from split_drake.objects.files.urdf import Inertial, UrdfBody, read_urdf
from split_drake.objects.meshes.decomposition import convex_hulls, convex_parts
from split_drake.objects.meshes.mass import is_closed, mass_properties
from split_drake.objects.meshes.mesh_file import SUFFIXES, ObjectFileError, read_mesh, tidied
from split_drake.objects.procedural.shape import hull, union
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import TaskObject
from split_drake.poses import Array

Role = Literal["collision", "visual"]

MASS_KG = (0.01, 2.0)


@dataclass(frozen=True)
class FolderContents:
    """What a folder of objects holds.

    Attributes:
        usable: {name: URDF or mesh file}, sorted by name.
        refused: {name: one sentence that says why an object is of no use}, sorted by name.
    """

    usable: dict[str, Path]
    refused: dict[str, str]


@dataclass(frozen=True)
class ObjectFolder:
    """The usable objects of a folder, as an `ObjectSource`; O is the frame of the file.

    The folder holds URDF files of one body each, as those of VGN, or else mesh files in metres, or
    folders with one of either.  An object is called as its file, or as the folder that holds it.
    Meshes beside a URDF file are taken for its parts.

    Attributes:
        path: the folder.
        cache: folder where convex decompositions are kept; made where it is missing.
        density_kg_m3: of an object whose file gives no mass, which is kept within `MASS_KG`.
        seen: which of a URDF file's meshes is the object's; the other one where it is missing.
            Contact is with the collision mesh either way.

    Raises ObjectFileError where the path is no folder, and ValueError where a number is impossible.
    """

    path: Path
    cache: Path
    density_kg_m3: float = 300.0
    seen: Role = "collision"

    def __post_init__(self) -> None:
        require_numbers(self)
        if not self.path.is_dir():
            raise ObjectFileError(f"{self.path} is no folder; expected one of URDF or mesh files")
        if not self.density_kg_m3 > 0.0:
            raise ValueError(f"density_kg_m3 is {self.density_kg_m3}; expected more than 0")
        if self.seen not in get_args(Role):
            raise ValueError(f"seen is {self.seen!r}; expected one of {get_args(Role)}")

    def contents(self) -> FolderContents:
        """Return which objects are usable, and why others are not; nothing is decomposed yet."""
        return inspect_folder(self.path)

    def names(self) -> tuple[str, ...]:
        """Return the names of the usable objects, sorted.

        Raises ObjectFileError where there is none.
        """
        contents = self.contents()
        if not contents.usable:
            reasons = "; ".join(list(contents.refused.values())[:1])
            raise ObjectFileError(f"{self.path} holds no usable object: {reasons}")
        return tuple(contents.usable)

    def load(self, name: str) -> TaskObject:
        """Return the object of that name, which has no task's poses.

        Raises ObjectFileError where there is none, or why it was refused.
        """
        contents = self.contents()
        if name in contents.refused:
            raise ObjectFileError(contents.refused[name])
        if name not in contents.usable:
            raise ObjectFileError(f"{self.path} holds no {name!r}; expected one of its objects")
        number = list(contents.usable).index(name)
        return TaskObject(body=self._body(name, contents.usable[name]), number=number)

    def sha256(self) -> str:
        """Return a hash of the folder's files and of how they are read."""
        files = {
            str(path.relative_to(self.path)): file_sha256(path)
            for path in sorted(self.path.rglob("*"))
            if path.is_file() and _is_shown(path)
        }
        return combined_sha256({**files, "read as": f"{self.density_kg_m3} {self.seen}"})

    def _body(self, name: str, path: Path) -> RigidObject:
        urdf = _read(path)
        touched = _mesh(urdf, "collision", path)
        try:
            hulls = convex_hulls(touched, self.cache)
        except ObjectFileError as error:
            raise ObjectFileError(f"{path}: {error}") from error
        mesh = _seen_mesh(_mesh(urdf, self.seen, path))
        inertial = _inertial(mesh, None if urdf is None else urdf.inertial, self.density_kg_m3)
        return RigidObject(
            name=name,
            mesh=mesh,
            mass_kg=inertial.mass_kg,
            p_OCom=inertial.p_LCom,
            inertia_kg_m2=inertial.inertia_kg_m2,
            collision=pieces_that_rest(hulls),
        )


@lru_cache(maxsize=8)
def inspect_folder(path: Path) -> FolderContents:
    """Return which objects of a folder are usable, and why the others are not.

    Raises ObjectFileError where it holds no URDF and no mesh file at all.
    """
    found = _object_files(path)
    if not found:
        raise ObjectFileError(
            f"{path} holds no object; expected URDF files or meshes ({', '.join(SUFFIXES)})"
        )
    usable: dict[str, Path] = {}
    refused: dict[str, str] = {}
    for name, files in sorted(found.items()):
        try:
            usable[name] = _only(name, files)
            _check(usable[name])
        except ObjectFileError as error:
            usable.pop(name, None)
            refused[name] = str(error)
    return FolderContents(usable, refused)


def _object_files(path: Path) -> dict[str, list[Path]]:
    """Return {name: files that would be the object}, of a folder and of those in it."""
    found = defaultdict(list)
    for file in _urdfs_or_meshes(path):
        found[file.stem].append(file)
    for inner in sorted(filter(Path.is_dir, path.iterdir())):
        if _is_shown(inner):
            found[inner.name] += _urdfs_or_meshes(inner)
    return {name: files for name, files in found.items() if files}


def _urdfs_or_meshes(folder: Path) -> list[Path]:
    files = sorted(path for path in folder.iterdir() if path.is_file() and _is_shown(path))
    urdfs = [path for path in files if path.suffix.lower() == ".urdf"]
    return urdfs or [path for path in files if path.suffix.lower() in SUFFIXES]


def _is_shown(path: Path) -> bool:
    """Return whether a file is no hidden one, such as those that macOS adds, "._mug.obj"."""
    return not path.name.startswith(".")


def _only(name: str, files: list[Path]) -> Path:
    if len(files) > 1:
        listed = ", ".join(file.name for file in files[:3]) + (", ..." if len(files) > 3 else "")
        raise ObjectFileError(
            f"{files[0].parent} holds {len(files)} files for {name!r} ({listed}); "
            "expected one a body"
        )
    return files[0]


def _check(path: Path) -> None:
    """Raise ObjectFileError where an object is of no use."""
    urdf = _read(path)
    for role in get_args(Role) if urdf is not None else ("collision",):
        _mesh(urdf, role, path)


def _read(path: Path) -> UrdfBody | None:
    return read_urdf(path) if path.suffix.lower() == ".urdf" else None


def _mesh(urdf: UrdfBody | None, role: Role, path: Path) -> trimesh.Trimesh:
    """Return a mesh of the object, its parts as they are."""
    if urdf is None:
        return read_mesh(path)
    first, second = urdf.collision, urdf.visual
    if role == "visual":
        first, second = second, first
    chosen = first or second
    assert chosen is not None  # `read_urdf` refuses bodies without a mesh
    return chosen.read()


def _seen_mesh(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh as cameras see it: convex parts that overlap become one solid."""
    parts = convex_parts(mesh)
    if parts is None or len(parts) == 1:
        return tidied(mesh)
    return union(*map(hull, parts)).mesh


def _inertial(mesh: trimesh.Trimesh, given: Inertial | None, density_kg_m3: float) -> Inertial:
    """Return what a file gives where a body can have it, and else what the mesh says."""
    if given is not None and given.is_possible_for(mesh):
        return given
    mass_kg = _mass_kg(mesh, density_kg_m3) if given is None else given.mass_kg
    return Inertial(mass_kg, *mass_properties(mesh, mass_kg))


def _mass_kg(mesh: trimesh.Trimesh, density_kg_m3: float) -> float:
    """Return the mass of a solid; of its hull where the mesh is open."""
    solid: Array = mesh.volume if is_closed(mesh) else mesh.convex_hull.volume
    return float(np.clip(solid * density_kg_m3, *MASS_KG))
