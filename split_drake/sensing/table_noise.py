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
# A clearance of so many standard deviations leaves about one point in 300,000 above it.
_DEVIATIONS = 4.5
# Noise that asks for more is no noise of a table, and would cost too much of what stands there.
_MOST_CLEARANCE_M = 0.02
# Depth in whole millimetres looks like a millimetre of noise: less than so many times the clearance
# that is there raises nothing.
_WORTH = 1.5
# The quarters of the lower half of a normal distribution, in deviations.  Strays, such as flying
# pixels, are few and further out.
_QUARTERS, _DEVIATIONS_BETWEEN = (0.25, 0.75), 1.1503 - 0.3186


def above_table_noise(workspace: Workspace, views: Sequence[DepthView]) -> Workspace:
    """Return the workspace with its clearance raised above the noise that the table shows.

    That is the noise of the worst view: cameras that disagree about the table's height are no
    noise.  The workspace stays as it is where that is less, or too little of the table is seen.
    """
    lowest_m = workspace.p_WCenter[2] - _BELOW_M
    stds = [table_noise_m(workspace, view.points(lowest_m, _STRIDE_PX)) for view in views]
    return _raised(workspace, max(stds, default=0.0))


def scene_above_noise(views: Sequence[DepthView], workspace: Workspace) -> Scene:
    """Return the scene that the views show of a workspace, without what is the table's noise.

    Raises EmptySceneError where no view shows anything else in the workspace.
    """
    scene = Scene.from_views(views, above_table_noise(workspace, views))
    # Networks are for a workspace as it was trained with; of what is lower there is nothing.
    return replace(scene, workspace=workspace)


def above_noise_of(workspace: Workspace, measured: Array) -> Workspace:
    """Return the workspace as `above_table_noise` does, by points (N, 3) in W, table included."""
    return _raised(workspace, table_noise_m(workspace, measured))


def _raised(workspace: Workspace, std_m: float) -> Workspace:
    clearance_m = min(_DEVIATIONS * std_m, _MOST_CLEARANCE_M)
    if clearance_m <= _WORTH * workspace.table_clearance_m:
        return workspace
    most_m = 0.5 * (workspace.edge_m - workspace.depth_below_m)
    raised_m = max(min(clearance_m, most_m), workspace.table_clearance_m)
    return replace(workspace, table_clearance_m=raised_m)


def table_noise_m(workspace: Workspace, measured: Array) -> float:
    """Return the standard deviation of the table's height in points (N, 3) in W; 0 where unknown.

    Points below the table's plane alone are looked at, and how the middle half of them spreads:
    objects stand above, a table that lies lower as a whole is no noise, and strays are few.
    """
    offsets = measured - workspace.p_WCenter
    beside = np.abs(offsets[:, :2]).max(axis=1, initial=0.0) < workspace.edge_m / 2.0
    heights = offsets[beside, 2]
    below = heights[(heights < 0.0) & (heights > -_BELOW_M)]
    if len(below) < _LEAST_POINTS:
        return 0.0
    low, high = np.quantile(below, _QUARTERS)
    return float((high - low) / _DEVIATIONS_BETWEEN)
