"""The stations that tests work with."""

from dataclasses import replace

from split_drake.poses import make_pose
from split_drake.scene import Workspace
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

STATION = StationConfig(Layout())


def raised_layout(height_m: float = 0.10) -> Layout:
    """Return the default layout with table, workspace, cameras and hook moved up."""
    layout = Layout()
    x, y, z = layout.workspace.p_WCenter
    return Layout(
        workspace=replace(Workspace(), p_WCenter=(x, y, z + height_m)),
        X_WK=make_pose(p=(0.0, 0.0, height_m)) @ layout.X_WK,
    )
