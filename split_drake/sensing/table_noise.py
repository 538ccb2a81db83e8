"""Up to which height what depth cameras show is the noise of the table itself."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from split_drake.camera import DepthView
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace

# Points this far below where the table should be may be its own: nothing else lies there.
_BELOW_M = 0.03
# One pixel in so many each way tells enough, in a ninth of the time.
_STRIDE_PX = 3
# Fewer points than this measure no noise.
_LEAST_POINTS = 500
# A clearance of so many standard deviations leaves about one point in 30,000 above it.
_DEVIATIONS = 4.0
# Of the lower half of a normal distribution: its median and its hundredth part, in deviations.
_HALF_MEDIAN, _HALF_TAIL = 0.6745, 2.5758


def above_table_noise(workspace: Workspace, views: Sequence[DepthView]) -> Workspace:
    """Return the workspace with its clearance raised above the noise that the table shows.

    It stays as it is where that is less, or where too little of the table is seen.
    """
    lowest_m = workspace.p_WCenter[2] - _BELOW_M
    shown = [view.points(lowest_m, _STRIDE_PX) for view in views]
    return above_noise_of(workspace, np.concatenate([np.empty((0, 3)), *shown]))


def scene_above_noise(views: Sequence[DepthView], workspace: Workspace) -> Scene:
    """Return the scene that the views show of a workspace, without what is the table's noise.

    Raises EmptySceneError where no view shows anything else in the workspace.
    """
    scene = Scene.from_views(views, above_table_noise(workspace, views))
    # Networks are for a workspace as it was trained with; of what is lower there is nothing.
    return replace(scene, workspace=workspace)


def above_noise_of(workspace: Workspace, measured: Array) -> Workspace:
    """Return the workspace as `above_table_noise` does, by points (N, 3) in W, table included."""
    clearance_m = _DEVIATIONS * table_noise_m(workspace, measured)
    if clearance_m <= workspace.table_clearance_m:
        return workspace
    most_m = workspace.edge_m - workspace.depth_below_m
    return replace(workspace, table_clearance_m=min(clearance_m, 0.5 * most_m))


def table_noise_m(workspace: Workspace, measured: Array) -> float:
    """Return the standard deviation of the table's height in points (N, 3) in W; 0 where unknown.

    Points below the table's plane alone are looked at, and how they spread: objects stand above,
    and a table that lies lower as a whole is no noise.
    """
    offsets = measured - workspace.p_WCenter
    beside = np.abs(offsets[:, :2]).max(axis=1) < workspace.edge_m / 2.0
    heights = offsets[beside, 2]
    below = heights[(heights < 0.0) & (heights > -_BELOW_M)]
    if len(below) < _LEAST_POINTS:
        return 0.0
    median, tail = np.quantile(below, (0.5, 0.01))
    return float((median - tail) / (_HALF_TAIL - _HALF_MEDIAN))
