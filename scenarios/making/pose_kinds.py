"""A picture of what pose sets are: `python -m scenarios.making.pose_kinds --out FILE.png`.

One mug on the station's table, once for each of its tasks: true poses, and the axes of one frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from scenarios.viewing.pose_drawing import pose_segments
from split_drake.bad_input import require_numbers
from split_drake.camera import Intrinsics, look_at, project
from split_drake.experiments.command import run_command
from split_drake.grasps.judge import feasible
from split_drake.grasps.sampling import sample_grasps
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask
from split_drake.poses import (
    Array,
    make_pose,
    rotation_x,
    rotation_z,
    transform_points,
)
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.station.station import Station

_AXIS_M = 0.05
_AXIS_COLORS = ("#d32f2f", "#2e7d32", "#1565c0")
_POSE_COLOR = "#ff9800"
_SHOWN_GRASPS = 3
_CAMERA = Intrinsics.centered(440, 380, focal_px=1000.0)
_CAPTIONS = {
    GRASP: "grasp: z approaches, y closes",
    HANDLE: "handle: y through its opening",
    UPRIGHT: "upright: z from base to rim",
}


@dataclass(frozen=True)
class PictureOptions:
    """What is drawn, and where to.

    Attributes:
        out: PNG file.
        mug: of the fixed splits.
        seed: chooses the grasps.
    """

    out: Path
    mug: str = "test_004"
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)


def true_poses(mug: MugShape, X_WO: Array, seed: int) -> Iterator[tuple[PoseTask, Array]]:
    """Yield each task of mugs with true poses (N, 4, 4) of a mug at X_WO (4, 4)."""
    labels = sample_grasps(mug.body, np.random.default_rng(seed), positives=60)
    possible = feasible(X_WO, labels.X_OGs, labels.openings_m, table_z_m=0.0)
    X_WGs = X_WO @ labels.X_OGs[possible]
    steepest = np.argsort(X_WGs[:, 2, 2], kind="stable")
    yield GRASP, X_WGs[steepest[:: max(1, len(steepest) // 6)][:_SHOWN_GRASPS]]
    for task in (HANDLE, UPRIGHT):
        yield task, mug.true_poses(task, X_WO)


def _draw(axes: Axes, task: PoseTask, X_WPs: Array, X_WC: Array) -> None:
    """Draw poses over a photograph, and the axes of the first of them."""
    lines = project(pose_segments(task, X_WPs), _CAMERA, X_WC)
    axes.add_collection(LineCollection(list(lines), colors=_POSE_COLOR, linewidths=2.0))
    ends = np.vstack([np.zeros(3), _AXIS_M * np.eye(3)])
    origin, *tips = project(transform_points(X_WPs[0], ends), _CAMERA, X_WC)
    for name, color, tip in zip("xyz", _AXIS_COLORS, tips, strict=True):
        axes.annotate("", tip, origin, arrowprops={"arrowstyle": "->", "color": color, "lw": 2.5})
        x, y = origin + 1.15 * (tip - origin)
        axes.text(x, y, name, color=color, fontsize=13, weight="bold")


def main(options: PictureOptions) -> None:
    """Write the picture."""
    mug = load_mug(options.mug)
    # On its side, rim and handle in view.
    X_WO = make_pose(rotation_z(-0.5) @ rotation_x(-np.pi / 2.0), (0.5, 0.0, 0.0))
    X_WO[2, 3] = -transform_points(X_WO, mug.body.mesh.vertices)[:, 2].min()
    station = Station(StationConfig(Layout()), [mug.body])
    station.place_object(0, X_WO)
    center = transform_points(X_WO, mug.body.mesh.vertices).mean(axis=0)
    X_WC = look_at(center + np.array([0.33, 0.16, 0.22]), center)
    photograph = station.photograph(_CAMERA, X_WC)
    figure = Figure(figsize=(12.0, 3.7))
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=0.93, wspace=0.01)
    poses = true_poses(mug, X_WO, options.seed)
    for axes, (task, X_WPs) in zip(figure.subplots(1, 3), poses, strict=True):
        axes.imshow(photograph)
        axes.set_title(_CAPTIONS[task])
        axes.set_axis_off()
        _draw(axes, task, X_WPs, X_WC)
        axes.set(xlim=(0, _CAMERA.width - 1), ylim=(_CAMERA.height - 1, 0))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out, dpi=100)


if __name__ == "__main__":
    run_command(main, PictureOptions, __doc__)
