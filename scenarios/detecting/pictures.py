"""Found poses over the images, or over a cloud from two sides."""

import io
from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from scenarios.viewing.pose_drawing import score_bands
from split_drake.camera import DepthView, project
from split_drake.pose_set import PoseSet, PoseSets
from split_drake.poses import Array, transform_points
from split_drake.scene import Scene

# So many of each task are drawn; more hide each other.
BEST = 15
_DPI, _EDGE_IN = 80, 4.0
# Axes of W that a cloud is drawn along, and what the picture is called.
_SIDES = (((0, 1), "from above"), ((0, 2), "from the side"))


def picture(scene: Scene, pose_sets: PoseSets) -> bytes:
    """Return a PNG: a column for each task, a row for each view, or for each side of a cloud."""
    rows = len(scene.views) or len(_SIDES)
    size = (_EDGE_IN * len(pose_sets), 0.85 * _EDGE_IN * rows)
    figure, axes = plt.subplots(
        rows, len(pose_sets), squeeze=False, figsize=size, layout="constrained"
    )
    for column, (name, poses) in enumerate(pose_sets.items()):
        best = poses.head(BEST)
        axes[0, column].set_title(f"{name}: best {len(best)} of {len(poses)}")
        for row in range(rows):
            if scene.views:
                _draw_view(axes[row, column], scene, scene.views[row], best)
            else:
                _draw_side(axes[row, column], scene, best, *_SIDES[row])
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=_DPI, format="png")
    plt.close(figure)
    return buffer.getvalue()


def _draw_view(axes: Axes, scene: Scene, view: DepthView, poses: PoseSet) -> None:
    """Draw a depth image around the workspace's points, and poses over it."""
    shown = np.where(view.depth_m > 0.0, view.depth_m, np.nan)
    uv = project(scene.p_WPs, view.intrinsics, view.X_WC)
    low, high = uv.min(axis=0), uv.max(axis=0)
    margin = 0.25 * (high - low).max()
    near = scene.p_WPs @ view.X_WC[:3, 2] - view.X_WC[:3, 3] @ view.X_WC[:3, 2]
    axes.imshow(shown, cmap="gray_r", vmin=near.min() - 0.05, vmax=near.max() + 0.1)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(high[1] + margin, low[1] - margin)
    axes.set_xticks([])
    axes.set_yticks([])
    for band in score_bands(poses):
        ends = _before(band.segments_W, view)
        lines = project(ends.reshape(-1, 3), view.intrinsics, view.X_WC).reshape(-1, 2, 2)
        axes.add_collection(LineCollection(list(lines), colors=[band.color], linewidths=1.2))


def _before(segments_W: Array, view: DepthView) -> Array:
    """Return those segments (S, 2, 3) that lie before the camera."""
    X_CW = np.linalg.inv(view.X_WC)
    z = transform_points(X_CW, segments_W.reshape(-1, 3))[:, 2].reshape(-1, 2)
    return segments_W[(z > 0.01).all(axis=1)]


def _draw_side(axes: Axes, scene: Scene, poses: PoseSet, side: Sequence[int], called: str) -> None:
    """Draw a cloud along one axis of W, and poses over it."""
    across, up = scene.p_WSs[:, list(side)].T
    axes.scatter(across, up, s=1.0, color="0.6", linewidths=0.0)
    for band in score_bands(poses):
        lines = band.segments_W[..., list(side)]
        axes.add_collection(LineCollection(list(lines), colors=[band.color], linewidths=1.2))
    axes.set_aspect("equal")
    axes.set_xlabel(f"{'xyz'[side[0]]} [m], {called}")
    axes.set_ylabel(f"{'xyz'[side[1]]} [m]")
