"""Stations from files."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from split_drake.bad_input import BadInputError
from split_drake.camera import look_at
from split_drake.poses import make_pose, rotation_x, rotation_z
from split_drake.scene import Workspace
from split_drake.sensing.camera_file import read_cameras
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import read_station, station_to_yaml
from split_drake.station.layout import Layout, OpenBin
from split_drake.station.layout_file import layout_from_fields, layout_to_fields
from tests.helpers.stations import STATION

INTRINSICS = {"width": 320, "height": 240, "fx": 300, "fy": 300, "cx": 159.5, "cy": 119.5}
CAMERA = {
    "name": "eye",
    "intrinsics": INTRINSICS,
    "look_at": {"position": [0.4, 0.5, 0.6], "target": [0.4, 0.1, 0.1]},
}


def read(folder: Path, content: object, usual: StationConfig = STATION) -> StationConfig:
    file = folder / "station.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return read_station(file, usual)


def same(one: StationConfig, other: StationConfig) -> bool:
    layouts = [layout_to_fields(station.layout) for station in (one, other)]
    plain = [asdict(replace(station, layout=Layout())) for station in (one, other)]
    return layouts[0] == layouts[1] and str(plain[0]) == str(plain[1])


def test_an_empty_section_leaves_all_as_it_is(tmp_path: Path) -> None:
    assert same(read(tmp_path, {"contact": {}}), STATION)


def test_every_section_is_honoured(tmp_path: Path) -> None:
    content = {
        "workspace": {"center": [0.4, 0.1, 0.1]},
        "table": {"size": [0.8, 1.0, 0.03], "center": [0.5, 0.1]},
        "cameras": [CAMERA],
        "hook": {
            "position": [0.5, -0.3, 0.5],
            "tilt_deg": 20,
            "yaw_deg": 15,
            "peg_radius_m": 0.005,
        },
        "bin": {"p_WRim": [0.0, -0.5, 0.1], "size_m": [0.3, 0.3, 0.2], "wall_m": 0.02},
        "home": [0.1, -0.9, 0.0, -2.5, 0.0, 1.6, 0.8],
        "depth_noise": "low",
        "contact": {
            "friction": 0.6,
            "contact_approximation": "lagged",
            "arm_kp_nm_per_rad": [9] * 7,
        },
    }
    station = read(tmp_path, content)
    layout = station.layout
    assert layout.workspace == Workspace(p_WCenter=(0.4, 0.1, 0.1))
    assert layout.table_z_m == 0.1
    assert (layout.table_size_m, layout.p_WTable) == ((0.8, 1.0, 0.03), (0.5, 0.1))
    (camera,) = layout.cameras
    assert (camera.name, camera.intrinsics.fx) == ("eye", 300.0)
    np.testing.assert_allclose(camera.X_WC, look_at([0.4, 0.5, 0.6], [0.4, 0.1, 0.1]))
    R_WK = rotation_z(np.radians(15)) @ rotation_x(np.radians(20))
    np.testing.assert_allclose(layout.X_WK, make_pose(R_WK, (0.5, -0.3, 0.5)))
    assert layout.hook == replace(Layout().hook, peg_radius_m=0.005)
    assert layout.bin == OpenBin((0.0, -0.5, 0.1), (0.3, 0.3, 0.2), 0.02)
    np.testing.assert_array_equal(layout.q_home, content["home"])
    assert station.depth_noise == "low"
    assert (station.friction, station.contact_approximation) == (0.6, "lagged")
    assert station.arm_kp_nm_per_rad == (9.0,) * 7
    assert station.time_step_s == STATION.time_step_s
    # What is written is the same station, and says all of it.
    assert same(read(tmp_path, station_to_yaml(station), StationConfig(Layout())), station)
    # And it is a file of cameras for images of one's own.
    assert read_cameras(tmp_path / "station.yaml").workspace == layout.workspace
    # Files of problems and datasets keep it.
    again = layout_from_fields(layout_to_fields(layout))
    np.testing.assert_array_equal(again.q_home, layout.q_home)
    assert again.table_z_m == 0.1


def test_cameras_look_at_the_workspace_where_none_are_given(tmp_path: Path) -> None:
    moved = read(tmp_path, {"workspace": {"center": [0.45, 0.1, 0.2]}}).layout
    for camera, usual in zip(moved.cameras, Layout().cameras, strict=True):
        np.testing.assert_allclose(camera.X_WC[:3, 3] - usual.X_WC[:3, 3], [-0.05, 0.1, 0.2])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"tabel": {}}, "has 'tabel'; expected workspace, cameras, table"),
        ({"table": {"height": 1}}, "table has 'height'; expected size, center"),
        (
            {"table": {"size": [0.7, 1.2, 0]}},
            r"table: size is \[0.7, 1.2, 0.0\]; expected 3 lengths",
        ),
        ({"table": 3}, "table is 3; expected size, center"),
        (
            {"workspace": {"center": [0.5, float("nan"), 0.0]}},
            "workspace: center is .*nan.*3 numbers",
        ),
        ({"workspace": {"center": [0.5, 0.0, -0.9]}}, "expected a table above the floor"),
        ({"workspace": {"center": [0.5, 0.0, 0.6]}}, "expected a hook above the table"),
        ({"hook": {"X_WK": np.eye(3).tolist()}}, "hook: X_WK is .*expected four rows"),
        ({"hook": {"X_WK": np.eye(4).tolist(), "tilt_deg": 3}}, "expected one of both"),
        ({"hook": {"peg_radius_m": "thin"}}, "hook: peg_radius_m is 'thin'; expected 1 numbers"),
        ({"hook": {"post_distance_m": 0.01}}, "a mug needs at least 0.06 m"),
        ({"home": [0.0] * 6}, "home is .*; expected 7 numbers"),
        ({"home": [0.0] * 7}, "joint 4 of q_home is 0.0; expected a number from -3.07"),
        ({"depth_noise": "some"}, "depth_noise is 'some'; expected one of"),
        ({"contact": {"friction": -1}}, "friction is -1.0; expected a positive number"),
        ({"contact": {"near_rigid_threshold": -1}}, "near_rigid_threshold is -1.0; expected"),
        ({"contact": {"contact_model": "soft"}}, "contact_model is 'soft'; expected one of"),
        ({"contact": {"gravity": 1}}, "contact has 'gravity'; expected time_step_s"),
        ({"cameras": [CAMERA, CAMERA]}, "cameras are called eye, eye; expected a name for each"),
        ({"bin": {"size_m": [1, 1, 1]}}, "bin has no 'p_WRim'"),
        ("", "holds no names with values; expected a station"),
        ("- 1", "holds no names with values; expected a station"),
        ("a: [", "is damaged or not a station"),
    ],
)
def test_what_cannot_be_used_is_told_in_a_sentence(tmp_path: Path, content: Any, said: str) -> None:
    with pytest.raises(BadInputError, match=said) as caught:
        read(tmp_path, content)
    assert str(tmp_path / "station.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)
