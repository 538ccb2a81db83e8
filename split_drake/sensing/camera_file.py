"""A file that says which cameras look at a table, from where, and at which part of it.

Each camera has a `name`, `intrinsics` (numbers, or the path of a calibration, from this file), and
a pose.  Optional is `unit_m`: metres of one unit of its images of whole numbers.
The pose is one of

- `look_at`: `position` and `target`, metres in W; optional is `down`, which way the image's y is
- `pose`: `position` and `quaternion_wxyz`
- `X_WC`: four rows of four numbers

The camera's frame is OpenCV's: x right, y down, z into the scene.
Optional is `workspace`, with the `center` of the cube's footprint on the table.
A station's file (`split_drake/station/file`) is such a file, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from split_drake.bad_input import BadInputError
from split_drake.camera import DepthView, look_at
from split_drake.files import interpreting
from split_drake.poses import Array, make_pose, nearest_pose
from split_drake.scene import Workspace
from split_drake.sensing.calibration_file import calibration_from, read_calibration
from split_drake.sensing.depth_file import MILLIMETRE_M, read_depth, read_mask
from split_drake.sensing.lens import Calibration
from split_drake.sensing.yaml_file import Fields, numbers, read_yaml, require_keys

WHAT = "a file of cameras, see split_drake/sensing/camera_file.py"
_POSES = ("look_at", "pose", "X_WC")
# A station's file may be given in place of one of cameras.
STATION_SECTIONS = ("table", "hook", "bin", "home", "depth_noise", "contact")


@dataclass(frozen=True)
class UserCamera:
    """A camera that looks at the table.

    Attributes:
        name: of the camera.
        calibration: of its images.
        X_WC: (4, 4) pose.
        unit_m: metres of one unit of its images, where these are whole numbers.
    """

    name: str
    calibration: Calibration
    X_WC: Array
    unit_m: float = MILLIMETRE_M

    def view(self, depth_file: Path, mask_file: Path | None = None) -> DepthView:
        """Return what an image shows, undistorted, without what a mask leaves out.

        Raises BadInputError where an image cannot be used; see `depth_file`.
        """
        depth_m = read_depth(depth_file, self.unit_m)
        try:
            if mask_file is not None:
                hidden = read_mask(mask_file)
                if hidden.shape != depth_m.shape:
                    raise BadInputError(
                        f"the mask {mask_file} has shape {hidden.shape}; expected {depth_m.shape}"
                    )
                depth_m = np.where(hidden, np.float32(0.0), depth_m)
            ideal = self.calibration.undistorted(depth_m)
            return DepthView(
                np.asarray(ideal, dtype=np.float32), self.calibration.intrinsics, self.X_WC
            )
        except ValueError as error:
            raise BadInputError(f"{depth_file}, of the camera {self.name}: {error}") from error


@dataclass(frozen=True)
class CameraFile:
    """What a file of cameras says.

    Attributes:
        cameras: in the file's order.
        workspace: that they look at; None where the file does not say.
    """

    cameras: Sequence[UserCamera]
    workspace: Workspace | None


def read_cameras(path: Path | str) -> CameraFile:
    """Return what a file of cameras says.

    Raises MissingFileError, and UnreadableFileError or BadInputError naming the camera and the key
    that cannot be used, and what was expected.
    """
    path = Path(path)
    fields = read_yaml(path, WHAT)
    with interpreting(path, WHAT):
        # What else a station's file holds is of no interest to a camera.
        known = ("cameras", "workspace", *STATION_SECTIONS)
        require_keys(fields, str(path), known, ("cameras",))
        cameras = cameras_of(fields["cameras"], str(path), path.parent)
        return CameraFile(cameras, _workspace(fields.get("workspace"), f"{path}: workspace"))


def cameras_of(given: Any, where: str, folder: Path) -> list[UserCamera]:
    """Return the cameras of a list in a file of that folder.

    Raises BadInputError naming the camera and the key that cannot be used.
    """
    if not isinstance(given, list) or not given:
        raise BadInputError(f"{where}: cameras is {given!r:.60}; expected a list of cameras")
    return [_camera(each, f"{where}: camera {i}", folder) for i, each in enumerate(given)]


def _camera(given: Any, where: str, folder: Path) -> UserCamera:
    known = ("name", "intrinsics", *_POSES, "unit_m")
    fields = require_keys(given, where, known, ("name", "intrinsics"))
    unit_m = numbers(fields.get("unit_m", MILLIMETRE_M), 1, f"{where}: unit_m")[0]
    calibration = calibration_of(fields["intrinsics"], f"{where}: intrinsics", folder)
    return UserCamera(str(fields["name"]), calibration, camera_pose(fields, where), unit_m)


def calibration_of(given: Any, where: str, folder: Path) -> Calibration:
    """Return the calibration that is given as numbers, or as a file's path from a folder."""
    if isinstance(given, str):
        return read_calibration(folder / given)
    if not isinstance(given, Mapping):
        raise BadInputError(f"{where} is {given!r:.60}; expected numbers, or the path of a file")
    return calibration_from(given, where)


def camera_pose(fields: Fields, where: str) -> Array:
    """Return X_WC (4, 4) of a camera whose fields have it as one of three keys.

    Raises BadInputError where there is none or more than one, or where it is no pose.
    """
    given = [key for key in _POSES if key in fields]
    if len(given) != 1:
        raise BadInputError(
            f"{where} has {' and '.join(given) or 'no pose'}; expected one of {', '.join(_POSES)}"
        )
    readers = {"look_at": _looking_at, "pose": _position_and_quaternion, "X_WC": pose_rows}
    try:
        return readers[given[0]](fields[given[0]], f"{where}: {given[0]}")
    except BadInputError:
        raise
    except ValueError as error:
        raise BadInputError(f"{where}: {error}") from error


def _looking_at(given: Any, where: str) -> Array:
    fields = require_keys(given, where, ("position", "target", "down"), ("position", "target"))
    position, target = (
        numbers(fields[key], 3, f"{where}: {key}") for key in ("position", "target")
    )
    down: ArrayLike = numbers(fields.get("down", [0.0, 0.0, -1.0]), 3, f"{where}: down")
    return look_at(position, target, down)


def _position_and_quaternion(given: Any, where: str) -> Array:
    names = ("position", "quaternion_wxyz")
    fields = require_keys(given, where, names, names)
    position = numbers(fields["position"], 3, f"{where}: position")
    quaternion = numbers(fields["quaternion_wxyz"], 4, f"{where}: quaternion_wxyz")
    if abs(np.linalg.norm(quaternion) - 1.0) > 0.01:
        raise BadInputError(f"{where}: quaternion_wxyz is {quaternion}; expected a length of 1")
    return make_pose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position)


def pose_rows(given: Any, where: str) -> Array:
    """Return a pose (4, 4) that is given as four rows; BadInputError naming `where` if none is."""
    if not isinstance(given, list) or len(given) != 4:
        raise BadInputError(f"{where} is {given!r:.60}; expected four rows of four numbers")
    return nearest_pose([numbers(row, 4, f"a row of {where}") for row in given], where)


def _workspace(given: Any, where: str) -> Workspace | None:
    if given is None:
        return None
    fields = require_keys(given, where, ("center",), ("center",))
    x, y, z = numbers(fields["center"], 3, f"{where}: center")
    return Workspace(p_WCenter=(x, y, z))
