"""Calibrations as ROS, OpenCV, RealSense and Open3D write them."""

from pathlib import Path
from typing import Any

import numpy as np

from split_drake.bad_input import BadInputError
from split_drake.camera import Intrinsics
from split_drake.files import interpreting
from split_drake.poses import Array
from split_drake.sensing.lens import Calibration, Lens
from split_drake.sensing.yaml_file import Fields, numbers, read_yaml, require_keys

WHAT = (
    "a camera's calibration: ROS camera_info, OpenCV's camera_matrix, RealSense's ppx and ppy, "
    "Open3D's intrinsic_matrix, or width, height, fx, fy, cx, cy and distortion"
)
# Files name by these the model that OpenCV's first five coefficients are of.
_BROWN_CONRADY = ("plumb_bob", "brown_conrady")
_PLAIN = ("width", "height", "fx", "fy", "cx", "cy")


def read_calibration(path: Path | str) -> Calibration:
    """Return the calibration in a YAML or JSON file, of whichever of the known kinds it is.

    Raises MissingFileError, and UnreadableFileError or BadInputError where the file is of no known
    kind, lacks a number, or has a distortion that is not OpenCV's with five coefficients.
    """
    fields = read_yaml(path, WHAT)
    with interpreting(path, WHAT):
        return calibration_from(fields, str(path))


def calibration_from(fields: Fields, where: str) -> Calibration:
    """Return the calibration in a mapping; `where` names it in messages.

    Raises BadInputError; see `read_calibration`.
    """
    if "camera_matrix" in fields:
        return _ros_or_opencv_file(fields, where)
    if "K" in fields or "k" in fields:
        return _ros_message(fields, where)
    if "ppx" in fields:
        return _realsense(fields, where)
    if "intrinsic_matrix" in fields:
        return _open3d(fields, where)
    require_keys(fields, where, (*_PLAIN, "distortion"), _PLAIN)
    focal_and_centre = (_number(fields, key, where) for key in _PLAIN[2:])
    camera = Intrinsics(*_size(fields, where), *focal_and_centre)
    return Calibration(camera, _lens(fields.get("distortion", ()), _BROWN_CONRADY[0], where))


def _ros_or_opencv_file(fields: Fields, where: str) -> Calibration:
    """Files of both have nearly the same keys."""
    matrix = _data(fields["camera_matrix"], f"{where}: camera_matrix")
    coefficients = fields.get("distortion_coefficients", fields.get("dist_coeffs"))
    data = () if coefficients is None else _data(coefficients, f"{where}: distortion_coefficients")
    lens = _lens(data, fields.get("distortion_model", _BROWN_CONRADY[0]), where)
    size = _size(fields, where, ("image_width", "image_height"))
    return Calibration(Intrinsics.from_matrix(_matrix(matrix, where), size), lens)


def _ros_message(fields: Fields, where: str) -> Calibration:
    """A `sensor_msgs/CameraInfo`, of ROS 1 (K, D) or ROS 2 (k, d)."""
    matrix = _matrix(fields.get("K", fields.get("k")), where)
    coefficients = fields.get("D", fields.get("d", ()))
    lens = _lens(coefficients, fields.get("distortion_model", _BROWN_CONRADY[0]), where)
    return Calibration(Intrinsics.from_matrix(matrix, _size(fields, where)), lens)


def _realsense(fields: Fields, where: str) -> Calibration:
    """The fields of an `rs2_intrinsics`."""
    names = ("fx", "fy", "ppx", "ppy")
    camera = Intrinsics(*_size(fields, where), *(_number(fields, name, where) for name in names))
    return Calibration(camera, _lens(fields.get("coeffs", ()), fields.get("model", "none"), where))


def _open3d(fields: Fields, where: str) -> Calibration:
    """A `PinholeCameraIntrinsic`, whose matrix is written column by column."""
    matrix = _matrix(fields["intrinsic_matrix"], where).T
    return Calibration(Intrinsics.from_matrix(matrix, _size(fields, where)))


def _size(
    fields: Fields, where: str, keys: tuple[str, str] = ("width", "height")
) -> tuple[int, int]:
    width, height = (_number(fields, key, where) for key in keys)
    if width % 1.0 or height % 1.0:
        raise BadInputError(
            f"{where}: the image has {width} x {height} pixels; expected whole ones"
        )
    return int(width), int(height)


def _number(fields: Fields, key: str, where: str) -> float:
    if key not in fields:
        raise BadInputError(f"{where} has no {key!r}; expected {WHAT}")
    return numbers(fields[key], 1, f"{where}: {key}")[0]


def _matrix(data: Any, where: str) -> Array:
    return np.array(numbers(data, 9, f"{where}: the camera matrix")).reshape(3, 3)


def _data(value: Any, where: str) -> Any:
    """Return the numbers of a matrix that is written as rows, cols and data, or as a list."""
    if isinstance(value, dict):
        if "data" not in value:
            raise BadInputError(f"{where} has no 'data'; expected rows, cols and data")
        return value["data"]
    rows = value if isinstance(value, list) else [value]
    return [number for row in rows for number in (row if isinstance(row, list) else [row])]


def _lens(coefficients: Any, model: Any, where: str) -> Lens:
    """Return the lens of up to five coefficients; there may be more where these are 0."""
    count = len(coefficients) if isinstance(coefficients, (list, tuple)) else 1
    values = numbers(coefficients, count, f"{where}: the distortion")
    if not any(values):
        return Lens()
    name = str(model).lower().removeprefix("distortion.").replace(" ", "_")
    if name not in _BROWN_CONRADY or any(values[5:]):
        raise BadInputError(
            f"{where}: the distortion is {values} of the model {str(model)!r}; expected OpenCV's "
            "k1, k2, p1, p2, k3 (plumb_bob): undistort such images yourself"
        )
    return Lens(*values[:5])
