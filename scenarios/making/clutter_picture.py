"""A picture of grasps in clutter.

    python -m scenarios.making.clutter_picture --checkpoint F --out FILE.png

A packed scene and a pile of objects as the rounds of a seed start, with grasps that SPLIT finds in
one noisy view, coloured by score as in recordings.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from scenarios.clutter.detection import FoundBy
from scenarios.clutter.detectors import split
from scenarios.clutter.observation import observe, side_camera
from scenarios.clutter.spec import SceneKind, draw_start, drawn_objects
from scenarios.clutter_removal import ClutterOptions, missing_rounds
from scenarios.viewing.pose_drawing import score_bands
from split_drake.bad_input import require_numbers
from split_drake.camera import Intrinsics, look_at, project
from split_drake.experiments.command import run_command
from split_drake.grasps.sampling import spread_evenly
from split_drake.pose_set import PoseSet
from split_drake.poses import Array
from split_drake.station.hand.hand_station import HandStation

_CAMERA = Intrinsics.centered(600, 460, focal_px=1120.0)
# Looked at, from the middle of the table; from the camera's side, a little higher and nearer.
_TARGET = np.array([0.0, 0.0, 0.03])
_OFFSET = np.array([0.08, -0.46, 0.40])


@dataclass(frozen=True)
class PictureOptions:
    """What is drawn, and where to.

    Attributes:
        checkpoint: weights of SPLIT.
        out: PNG file.
        seed: of the rounds whose starts are shown.
        objects: "procedural", kinds that no model was trained on, or those to choose settings on.
        shown: grasps in each scene, spread over the better half of those that are found.
    """

    checkpoint: Path
    out: Path
    seed: int = 0
    objects: Literal["procedural", "procedural-train"] = "procedural"
    shown: int = 16

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if not self.checkpoint.is_file():
            raise ValueError(f"--checkpoint: there is no file {self.checkpoint}")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; expected 0 or more")
        if self.shown < 1:
            raise ValueError(f"--shown is {self.shown}; expected 1 or more")


def detected(options: PictureOptions, scene: SceneKind) -> tuple[HandStation, PoseSet]:
    """Return a scene's first round as it starts, and what is found in it."""
    asked = ClutterOptions(
        scene, 1, 1, options.seed, checkpoint=options.checkpoint, objects=options.objects
    )
    (spec,) = missing_rounds(asked, options.out.parent, ())
    start_rng, noise_rng, rng = spec.streams()
    station = HandStation(drawn_objects(spec, start_rng), spec.layout)
    draw_start(spec, station, start_rng)
    (view,) = station.capture([side_camera(spec.layout.workspace)])
    seen = observe(view, spec.layout.workspace, spec.noise, noise_rng)
    return station, FoundBy(split.load(options.checkpoint)).detect(seen, rng)


def draw(axes: Axes, found: PoseSet, X_WC: Array, shown: int) -> None:
    """Draw so many of the better half of the grasps over a photograph."""
    better = found.head(max(shown, len(found) // 2))
    spread = np.sort(spread_evenly(better.X_WPs, shown))
    some = PoseSet(found.task, better.X_WPs[spread], better.scores[spread])
    for band in score_bands(some):
        lines = project(band.segments_W, _CAMERA, X_WC)
        axes.add_collection(LineCollection(list(lines), colors=[band.color], linewidths=1.6))


def main(options: PictureOptions) -> None:
    """Write the picture."""
    figure = Figure(figsize=(12.0, 4.6))
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=1.0, wspace=0.01)
    scenes: tuple[SceneKind, ...] = ("packed", "pile")
    for axes, scene in zip(figure.subplots(1, 2), scenes, strict=True):
        station, found = detected(options, scene)
        target = np.array(station.config.layout.workspace.p_WCenter) + _TARGET
        X_WC = look_at(target + _OFFSET, target)
        axes.imshow(station.photograph(_CAMERA, X_WC))
        draw(axes, found, X_WC, options.shown)
        axes.set_axis_off()
        axes.set(xlim=(0, _CAMERA.width - 1), ylim=(_CAMERA.height - 1, 0))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out, dpi=100)


if __name__ == "__main__":
    run_command(main, PictureOptions, __doc__)
