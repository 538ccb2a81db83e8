"""Stations as YAML: where cameras, table, hook and bin stand, and how the simulation is set.

All sections are optional; what is left out is as in the usual station (`Layout`, `StationConfig`;
trials step by 2.5 ms)::

    workspace: {center: [0.5, 0.0, 0.1]}   # of the cube's footprint; z is the table's height
    table: {size: [0.7, 1.2, 0.05], center: [0.55, 0.0]}
    cameras: ...                           # as in split_drake/sensing/camera_file.py
    hook: {position: [0.5, -0.38, 0.5], tilt_deg: 10, yaw_deg: 0, peg_radius_m: 0.006}
    bin: {p_WRim: [-0.05, -0.5, 0.0], size_m: [0.34, 0.34, 0.18], wall_m: 0.01}
    home: [0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785]
    depth_noise: middle
    contact: {friction: 0.8, time_step_s: 0.0025}

A hook is turned by `yaw_deg` about z of W after it was tilted by `tilt_deg` about its own x; in
place of position and angles it may have `X_WK`, four rows.  It may have the numbers of `HookShape`,
and `contact` those of `StationConfig`.  Without `cameras` there are two that look at the workspace.
"""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from split_drake.bad_input import BadInputError
from split_drake.files import interpreting
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.scene import Workspace
from split_drake.sensing.camera_file import STATION_SECTIONS, cameras_of, pose_rows
from split_drake.sensing.yaml_file import Fields, numbers, read_yaml, require_keys
from split_drake.station.config import PHYSICS, StationConfig
from split_drake.station.layout import CameraPlacement, HookShape, Layout, OpenBin

WHAT = "a station, see split_drake/station/file/station_file.py"
SECTIONS = ("workspace", "cameras", *STATION_SECTIONS)
_HOOK_POSE = ("position", "tilt_deg", "yaw_deg", "X_WK")
_HOOK_SHAPE = tuple(entry.name for entry in fields(HookShape))


def read_station(path: Path | str, usual: StationConfig) -> StationConfig:
    """Return the station of a YAML file.

    Args:
        path: of the file.
        usual: what all is like that the file leaves out; the size of its workspace stays.

    Raises MissingFileError, and UnreadableFileError or BadInputError naming the key that cannot be
    used, and what was expected.
    """
    path = Path(path)
    given = read_yaml(path, WHAT)
    with interpreting(path, WHAT):
        require_keys(given, str(path), SECTIONS)
        contact = require_keys(given.get("contact", {}), "contact", PHYSICS)
        return replace(
            usual,
            layout=_layout(given, usual.layout, path.parent),
            depth_noise=given.get("depth_noise", usual.depth_noise),
            **{key: _contact_value(key, value) for key, value in contact.items()},
        )


def station_to_yaml(config: StationConfig) -> str:
    """Return the whole station as YAML that `read_station` reads, nothing left out."""
    layout = config.layout
    content = {
        "workspace": {"center": _listed(layout.workspace.p_WCenter)},
        "table": {"size": _listed(layout.table_size_m), "center": _listed(layout.p_WTable)},
        "cameras": [
            {
                "name": camera.name,
                "intrinsics": asdict(camera.intrinsics),
                "X_WC": _listed(camera.X_WC),
            }
            for camera in layout.cameras
        ],
        "hook": {"X_WK": _listed(layout.X_WK), **asdict(layout.hook)},
        "home": _listed(layout.q_home),
        "depth_noise": config.depth_noise,
        "contact": {key: _plain(value) for key, value in config.physics().items()},
    }
    if layout.bin is not None:
        content["bin"] = {key: _plain(value) for key, value in asdict(layout.bin).items()}
    return yaml.safe_dump(content, sort_keys=False)


def _listed(values: Any) -> Any:
    return np.asarray(values, dtype=float).tolist()


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _layout(given: Fields, usual: Layout, folder: Path) -> Layout:
    workspace = _workspace(given.get("workspace"), usual.workspace)
    table = require_keys(given.get("table", {}), "table", ("size", "center"))
    x, y = numbers(_plain(table.get("center", usual.p_WTable)), 2, "table: center")
    X_WK, hook = _hook(given.get("hook", {}), usual)
    # Without cameras of its own a station has the usual two, which look at its workspace.
    return Layout(
        workspace=workspace,
        cameras=_cameras(given["cameras"], folder) if "cameras" in given else (),
        X_WK=X_WK,
        hook=hook,
        bin=_bin(given["bin"]) if "bin" in given else usual.bin,
        table_size_m=_lengths(table.get("size", usual.table_size_m), 3, "table: size"),
        p_WTable=(x, y),
        q_home=np.array(numbers(_listed(given.get("home", usual.q_home)), 7, "home")),
    )


def _lengths(given: Any, count: int, where: str) -> Any:
    lengths = tuple(numbers(_plain(given), count, where))
    if min(lengths) <= 0.0:
        raise BadInputError(f"{where} is {list(lengths)}; expected {count} lengths in metres")
    return lengths


def _workspace(given: Any, usual: Workspace) -> Workspace:
    if given is None:
        return usual
    known = require_keys(given, "workspace", ("center",), ("center",))
    x, y, z = numbers(known["center"], 3, "workspace: center")
    return replace(usual, p_WCenter=(x, y, z))


def _cameras(given: Any, folder: Path) -> tuple[CameraPlacement, ...]:
    cameras = cameras_of(given, "cameras", folder)
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names):
        raise BadInputError(f"cameras are called {', '.join(names)}; expected a name for each")
    # Simulated cameras have no lens: a user's images are undistorted where they are read.
    return tuple(CameraPlacement(c.name, c.calibration.intrinsics, c.X_WC) for c in cameras)


def _hook(given: Any, usual: Layout) -> tuple[Array, HookShape]:
    known = require_keys(given, "hook", (*_HOOK_POSE, *_HOOK_SHAPE))
    shape = {key: numbers(known[key], 1, f"hook: {key}")[0] for key in known if key in _HOOK_SHAPE}
    return _hook_pose(known, usual.X_WK), replace(usual.hook, **shape)


def _hook_pose(known: Fields, X_WKUsual: Array) -> Array:
    angles = [key for key in ("tilt_deg", "yaw_deg") if key in known]
    if "X_WK" in known:
        if "position" in known or angles:
            raise BadInputError("hook has X_WK and position or angles; expected one of both")
        return pose_rows(known["X_WK"], "hook: X_WK")
    position = numbers(known.get("position", _listed(X_WKUsual[:3, 3])), 3, "hook: position")
    if not angles:
        return make_pose(X_WKUsual[:3, :3], position)
    tilt, yaw = (
        np.radians(numbers(known.get(key, 0.0), 1, f"hook: {key}")[0])
        for key in ("tilt_deg", "yaw_deg")
    )
    return make_pose(rotation_z(yaw) @ rotation_x(tilt), position)


def _bin(given: Any) -> OpenBin:
    names = tuple(entry.name for entry in fields(OpenBin))
    known = require_keys(given, "bin", names, names)
    x, y, z = numbers(known["p_WRim"], 3, "bin: p_WRim")
    wall_m = numbers(known["wall_m"], 1, "bin: wall_m")[0]
    return OpenBin((x, y, z), _lengths(known["size_m"], 3, "bin: size_m"), wall_m)


def _contact_value(key: str, value: Any) -> Any:
    """Return a value of `contact` as `StationConfig` has it; that checks it further."""
    usual = StationConfig.__dataclass_fields__[key].default
    if isinstance(usual, tuple):
        return tuple(numbers(value, len(usual), f"contact: {key}"))
    return value if isinstance(usual, str) else numbers(value, 1, f"contact: {key}")[0]
