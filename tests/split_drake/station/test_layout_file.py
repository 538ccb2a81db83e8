"""Layouts as JSON."""

import json
from dataclasses import replace

import numpy as np

from split_drake.camera import Intrinsics
from split_drake.poses import make_pose, rotation_x
from split_drake.scene import Workspace
from split_drake.station.layout import CameraPlacement, HookShape, Layout, OpenBin, same_fixtures
from split_drake.station.layout_file import (
    layout_from_fields,
    layout_from_json,
    layout_to_fields,
    layout_to_json,
)

CAMERA = CameraPlacement(
    "wrist", Intrinsics(320, 240, 250.0, 251.0, 159.5, 119.5), make_pose(rotation_x(2.0), (0, 1, 2))
)
LAYOUT = Layout(
    workspace=Workspace((0.6, 0.1, 0.02), 0.4, 0.06, 0.005),
    cameras=(CAMERA,),
    X_WK=make_pose(rotation_x(0.2), (0.4, -0.3, 0.5)),
    hook=HookShape(peg_radius_m=0.005),
    table_size_m=(0.8, 1.0, 0.04),
    p_WTable=(0.5, 0.02),
)


def test_a_layout_survives_as_fields() -> None:
    read = layout_from_fields(json.loads(json.dumps(layout_to_fields(LAYOUT))))
    assert same_fixtures(read, LAYOUT)
    assert read.workspace == LAYOUT.workspace
    (camera,) = read.cameras
    assert (camera.name, camera.intrinsics) == (CAMERA.name, CAMERA.intrinsics)
    np.testing.assert_array_equal(camera.X_WC, CAMERA.X_WC)


def test_a_planners_layout_has_no_cameras() -> None:
    text = layout_to_json(LAYOUT)
    assert "cameras" not in json.loads(text)
    assert text == layout_to_json(replace(LAYOUT, cameras=()))
    read = layout_from_json(text)
    assert same_fixtures(read, LAYOUT)
    assert len(read.cameras) == 2, "the default's two views of the workspace"


def test_a_bin_is_kept_and_its_absence_too() -> None:
    beside = OpenBin((0.1, -0.6, 0.02), (0.3, 0.2, 0.15), 0.012)
    binned = replace(LAYOUT, bin=beside)
    assert layout_from_json(layout_to_json(binned)).bin == beside
    assert "bin" not in json.loads(layout_to_json(LAYOUT))
    assert layout_from_json(layout_to_json(LAYOUT)).bin is None
    assert not same_fixtures(binned, LAYOUT)
