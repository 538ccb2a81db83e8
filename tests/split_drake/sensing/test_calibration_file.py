"""Calibrations that other software writes."""

import json
from pathlib import Path

import pytest

from split_drake.bad_input import BadInputError
from split_drake.camera import Intrinsics
from split_drake.files import MissingFileError, UnreadableFileError
from split_drake.sensing.calibration_file import read_calibration
from split_drake.sensing.lens import Calibration, Lens
from tests.helpers.damage import times_told

CAMERA = Intrinsics(640, 480, 601.5, 602.5, 320.25, 240.75)
BENT = Lens(0.1, -0.2, 0.001, -0.002, 0.05)

ROS_FILE = """
image_width: 640
image_height: 480
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [601.5, 0, 320.25, 0, 602.5, 240.75, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0.001, -0.002, 0.05]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
"""
ROS_MESSAGE = """
header: {seq: 1, frame_id: "camera_depth"}
height: 480
width: 640
distortion_model: "plumb_bob"
D: [0.1, -0.2, 0.001, -0.002, 0.05]
K: [601.5, 0.0, 320.25, 0.0, 602.5, 240.75, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
---
header: {seq: 2}
"""
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 601.5, 0., 320.25, 0., 602.5, 240.75, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -0.2, 0.001, -0.002, 0.05 ]
"""
REALSENSE = json.dumps(
    {
        "width": 640,
        "height": 480,
        "fx": 601.5,
        "fy": 602.5,
        "ppx": 320.25,
        "ppy": 240.75,
        "model": "distortion.brown_conrady",
        "coeffs": [0.1, -0.2, 0.001, -0.002, 0.05],
    }
)
OPEN3D = json.dumps(
    {
        "width": 640,
        "height": 480,
        "intrinsic_matrix": [601.5, 0, 0, 0, 602.5, 0, 320.25, 240.75, 1],
    }
)
PLAIN = """
{width: 640, height: 480, fx: 601.5, fy: 602.5, cx: 320.25, cy: 240.75,
 distortion: [0.1, -0.2, 0.001, -0.002, 0.05]}
"""


def read(folder: Path, text: str) -> Calibration:
    file = folder / "camera.yaml"
    file.write_text(text)
    return read_calibration(file)


@pytest.mark.parametrize("text", [ROS_FILE, ROS_MESSAGE, OPENCV, REALSENSE, PLAIN])
def test_calibrations_of_all_kinds_say_the_same(tmp_path: Path, text: str) -> None:
    assert read(tmp_path, text) == Calibration(CAMERA, BENT)


def test_the_matrix_of_open3d_is_written_by_columns(tmp_path: Path) -> None:
    assert read(tmp_path, OPEN3D) == Calibration(CAMERA)


def test_a_distortion_of_zeros_is_none_whatever_the_model(tmp_path: Path) -> None:
    text = REALSENSE.replace("brown_conrady", "inverse_brown_conrady")
    text = text.replace("[0.1, -0.2, 0.001, -0.002, 0.05]", "[0, 0, 0, 0, 0]")
    assert not read(tmp_path, text).lens.distorts


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (REALSENSE.replace("brown_conrady", "inverse_brown_conrady"), "undistort such images"),
        (ROS_FILE.replace("plumb_bob", "equidistant"), "'equidistant'; expected OpenCV's"),
        (ROS_FILE.replace("0.05]", "0.05, 0.1]"), "expected OpenCV's k1, k2, p1, p2, k3"),
        (ROS_FILE.replace("image_width: 640", "width: 640"), "has no 'image_width'"),
        (ROS_FILE.replace("601.5", ".nan"), "the camera matrix is .*nan.*; expected 9 numbers"),
        (ROS_FILE.replace("601.5, 0,", "601.5, 2,"), "expected \\[\\[fx, 0, cx\\]"),
        (ROS_FILE.replace("640", "640.5"), "640.5 x 480.* pixels; expected whole ones"),
        (PLAIN.replace("fx: 601.5", "fx: wide"), "fx is 'wide'; expected 1 numbers"),
        (PLAIN.replace("fx: 601.5", "f: 601.5"), "has 'f'; expected width, height"),
        (PLAIN.replace("0.1,", "100,"), "k1 is 100.0; expected one of OpenCV's"),
        ("", "holds no names with values"),
        ("[1, 2]", "holds no names with values"),
        ("a: [1", "is damaged or not a camera's calibration"),
        ("camera_matrix: {rows: 3}", "has no 'data'"),
        ("camera_matrix: !!opencv-matrix 3", "has no rows, cols and data"),
        ("K: !!python/object/apply:os.system [ls]", "is damaged or not"),
    ],
)
def test_what_is_no_calibration_is_told_in_a_sentence(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BadInputError, match=said) as caught:
        read(tmp_path, text)
    assert str(tmp_path / "camera.yaml") in str(caught.value)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="there is no file"):
        read_calibration(tmp_path / "none.yaml")


def test_all_damage_is_told(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(OPENCV)
    assert times_told(file, read_calibration) > 20
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UnreadableFileError, match="is damaged or not"):
        read_calibration(file)
