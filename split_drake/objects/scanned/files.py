"""Mugs from mesh files: read, brought to metres with z up, and made a mug of."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import trimesh

from split_drake.objects.meshes.mesh_file import Y_UP_TO_Z_UP, ObjectFileError, parse_mesh
from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.scanned.build import MAX_SIZE_M, MIN_SIZE_M, build_mug
from split_drake.objects.scanned.folder import NoMugsError, mug_files
from split_drake.poses import Array, invert_pose

# Other units are assumed of what would be a common mug by them, and no mug in metres.
_UNITS_M = {"millimetres": 1e-3, "centimetres": 1e-2}
_MIN_COMMON_M = 0.05


@dataclass(frozen=True)
class ReadMug:
    """A mug from a file.

    Attributes:
        shape: the mug.
        remarks: what was assumed of its file, a clause each; none of an upright mug in metres.
    """

    shape: MugShape
    remarks: tuple[str, ...]


def load_mug_folder(folder: Path) -> tuple[MugShape, ...]:
    """Return the mugs of a folder of mesh files, see `find_mug_files`, sorted by name.

    Raises NoMugsError as that does, and InvalidMugError, naming the file, where a mesh is no mug.
    """
    return tuple(load_mug_file(path, name) for name, path in mug_files(folder).items())


def load_mug_file(path: Path, name: str | None = None) -> MugShape:
    """Return the mug of a mesh file, see `read_mug_file`."""
    return read_mug_file(path, name).shape


def read_mug_file(path: Path, name: str | None = None) -> ReadMug:
    """Return the mug of a mesh file, called `name` or else as the file.

    The file holds one mug, wherever it stands and whichever way its handle points, upright.  That
    is with z up, and y up in glTF, or the other way round where it is a mug only so.  Units are
    metres, and millimetres or centimetres where it would be a common mug in these alone.  Gaps and
    inner surfaces do no harm as long as rays meet body and handle.

    Raises NoMugsError where there is no file, and InvalidMugError where the mesh is no mug: the
    file, the reason, and the numbers.
    """
    if not path.is_file():
        raise NoMugsError(f"{path} is no file; expected a mesh of a mug")
    try:
        mesh, unit_remarks = _in_metres(parse_mesh(path))
    except ObjectFileError as error:
        raise InvalidMugError(str(error)) from error
    except InvalidMugError as error:
        raise InvalidMugError(f"{path}: {error}") from error
    called, faults = path.stem if name is None else name, []
    for upright, up_remarks in _ways_up(mesh, path):
        try:
            built = build_mug(called, upright)
        except InvalidMugError as error:
            faults.append(error)
        else:
            return ReadMug(built.shape, (*unit_remarks, *up_remarks, *built.remarks))
    raise InvalidMugError(f"{path}: {faults[0]}") from faults[0]


def _in_metres(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    size = float(mesh.extents.max())
    if MIN_SIZE_M <= size <= MAX_SIZE_M:
        return mesh, ()
    for unit, unit_m in _UNITS_M.items():
        if _MIN_COMMON_M <= size * unit_m <= MAX_SIZE_M:
            return mesh.copy().apply_scale(unit_m), (f"its units are taken for {unit}",)
    raise InvalidMugError(
        f"wrong size: it measures {size:.4g} m along its longest edge, expected {MIN_SIZE_M:g} to "
        f"{MAX_SIZE_M:g} m; are its units metres?"
    )


def _ways_up(
    mesh: trimesh.Trimesh, path: Path
) -> Iterator[tuple[trimesh.Trimesh, tuple[str, ...]]]:
    """Yield the mesh as its kind of file has it upright, and the other way, with a remark."""
    yield mesh, ()
    X: Array = Y_UP_TO_Z_UP
    up = "y"
    if path.suffix.lower() == ".glb":
        X, up = invert_pose(X), "z"
    yield mesh.copy().apply_transform(X), (f"its {up} axis is taken for up",)
