"""A layout as JSON, for files that depend on where table, hook and cameras stand."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from split_drake.camera import Intrinsics
from split_drake.robot.posture import Q_HOME
from split_drake.scene import Workspace
from split_drake.station.layout import CameraPlacement, HookShape, Layout, OpenBin


def layout_to_fields(layout: Layout) -> dict[str, Any]:
    """Return the layout as values that JSON has."""
    return {**_fixtures(layout), "cameras": [_camera(each) for each in layout.cameras]}


def layout_from_fields(fields: Mapping[str, Any]) -> Layout:
    """Return the layout; without `cameras` among the fields it has those of `Layout`'s default."""
    return Layout(
        workspace=Workspace.from_fields(fields["workspace"]),
        cameras=tuple(_camera_from(each) for each in fields.get("cameras", ())),
        X_WK=np.array(fields["X_WK"]),
        hook=HookShape(**fields["hook"]),
        bin=_bin_from(fields.get("bin")),
        table_size_m=tuple(fields["table_size_m"]),
        p_WTable=tuple(fields["p_WTable"]),
        q_home=np.array(fields.get("q_home", Q_HOME)),
    )


def layout_to_json(layout: Layout) -> str:
    """Return the layout without its cameras, of which planners know nothing, as a line of JSON."""
    return json.dumps(_fixtures(layout), sort_keys=True)


def layout_from_json(text: str) -> Layout:
    """Return the layout; its cameras are those that `Layout` has by default."""
    return layout_from_fields(json.loads(text))


def _fixtures(layout: Layout) -> dict[str, Any]:
    bin_there = {} if layout.bin is None else {"bin": asdict(layout.bin)}
    # Left out where it is the usual one: files of before have none, and are still the same.
    usual = np.array_equal(layout.q_home, Q_HOME)
    home = {} if usual else {"q_home": np.asarray(layout.q_home).tolist()}
    return {
        **bin_there,
        "workspace": asdict(layout.workspace),
        "X_WK": np.asarray(layout.X_WK).tolist(),
        "hook": asdict(layout.hook),
        "table_size_m": list(layout.table_size_m),
        "p_WTable": list(layout.p_WTable),
        **home,
    }


def _bin_from(fields: Mapping[str, Any] | None) -> OpenBin | None:
    if fields is None:
        return None
    return OpenBin(tuple(fields["p_WRim"]), tuple(fields["size_m"]), fields["wall_m"])


def _camera(camera: CameraPlacement) -> dict[str, Any]:
    return {
        "name": camera.name,
        "intrinsics": asdict(camera.intrinsics),
        "X_WC": np.asarray(camera.X_WC).tolist(),
    }


def _camera_from(fields: Mapping[str, Any]) -> CameraPlacement:
    return CameraPlacement(
        fields["name"], Intrinsics(**fields["intrinsics"]), np.array(fields["X_WC"])
    )
