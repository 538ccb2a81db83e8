"""Point clouds from files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from pypcd4 import PointCloud

from split_drake.bad_input import BadInputError
from split_drake.files import MissingFileError, UnreadableFileError, read_npz
from split_drake.poses import Array

WHAT = "a point cloud in metres: PLY, PCD, NPY (N, 3), or NPZ with 'cloud' or 'points'"


def read_cloud(path: Path | str) -> Array:
    """Return the points (N, 3) of a PLY, PCD, NPY or NPZ, in the frame that the file is in.

    Colours and normals are left out.  Points that were not seen may be NaN.

    Raises MissingFileError, and UnreadableFileError or BadInputError where it is no cloud.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise BadInputError(f"{path} ends in {path.suffix!r}; expected {WHAT}")
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}; expected {WHAT}")
    try:
        points = reader(path)
    except BadInputError:
        raise
    # The readers of three packages raise whatever they trip over in damaged bytes.
    except Exception as error:
        told = ascii(f"{type(error).__name__}: {error}".splitlines()[0][:200])[1:-1]
        raise UnreadableFileError(f"{path} is damaged or not {WHAT}: {told}") from error
    return _checked(points, path)


def _checked(points: Array, path: Path) -> Array:
    # Clouds that are organized as an image have three axes.
    points = points.reshape(-1, 3) if points.ndim == 3 and points.shape[2] == 3 else points
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise BadInputError(
            f"{path} has shape {points.shape} and type {points.dtype}; expected (N, 3) numbers"
        )
    return points.astype(float)


def _ply(path: Path) -> Array:
    return np.asarray(trimesh.load(path, process=False).vertices)


def _pcd(path: Path) -> Array:
    cloud = PointCloud.from_path(path)
    if missing := [name for name in "xyz" if name not in cloud.fields]:
        raise BadInputError(f"{path} has no field {missing[0]!r}; expected x, y and z")
    return np.asarray(cloud.numpy(("x", "y", "z")))


def _npy(path: Path) -> Array:
    return np.asarray(np.load(path, allow_pickle=False))


def _npz(path: Path) -> Array:
    arrays = read_npz(path, WHAT)
    for name in ("cloud", "points"):
        if name in arrays:
            return arrays[name]
    raise BadInputError(f"{path} holds {', '.join(sorted(arrays)) or 'nothing'}; expected {WHAT}")


_READERS: dict[str, Callable[[Path], Array]] = {
    ".ply": _ply,
    ".pcd": _pcd,
    ".npy": _npy,
    ".npz": _npz,
}
