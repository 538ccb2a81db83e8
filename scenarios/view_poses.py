"""Show a saved pose set with the cloud it was found in: `python -m scenarios.view_poses FILE.npz`.

Needs no plant and no robot, only the meshcat package.
"""

import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import meshcat
import meshcat.geometry as geometry
import numpy as np
import tyro

from scenarios.viewing.pose_drawing import ColoredSegments, score_bands
from scenarios.viewing.static_page import static_visualizer
from split_drake.bad_input import require_count
from split_drake.experiments.command import run_command
from split_drake.files import write_atomically
from split_drake.pose_set import PoseSets, load_pose_sets
from split_drake.poses import Array, make_pose

# How many poses of each set are shown where nobody asks for more.
BEST = 50
_CLOUD_COLOR = (0.25, 0.35, 0.5)


@dataclass(frozen=True)
class ViewOptions:
    """Write a static HTML page that shows a saved pose set and its cloud.

    Attributes:
        file: pose sets as saved by a trial or by `save_pose_sets`.
        out: the page; beside the file where not given.
        best: show only the best poses of each set.
        open: open the page in a browser.
    """

    file: Annotated[Path, tyro.conf.Positional]
    out: Path | None = None
    best: int = BEST
    open: bool = False

    def __post_init__(self) -> None:
        require_count("best", self.best)


def _hex(color: tuple[float, float, float]) -> int:
    red, green, blue = (round(255 * channel) for channel in color)
    return red << 16 | green << 8 | blue


def _draw_cloud(path: meshcat.Visualizer, p_WPs: Array) -> None:
    colors = np.tile(np.array(_CLOUD_COLOR, dtype=np.float32)[:, None], len(p_WPs))
    points = geometry.PointsGeometry(p_WPs.T.astype(np.float32), color=colors)
    path.set_object(geometry.Points(points, geometry.PointsMaterial(size=0.002)))


def _draw_segments(path: meshcat.Visualizer, colored: ColoredSegments) -> None:
    vertices = colored.segments_W.reshape(-1, 3).T.astype(np.float32)
    path.set_object(
        geometry.LineSegments(
            geometry.PointsGeometry(vertices),
            geometry.LineBasicMaterial(color=_hex(colored.color), linewidth=2),
        )
    )


def render_page(pose_sets: PoseSets, p_WPs: Array) -> str:
    """Return a self-contained HTML page with the cloud (N, 3) and the pose sets in W."""
    visualizer, window = static_visualizer()
    # The camera orbits the origin, so the scene is moved there.
    scene = visualizer["scene"]
    scene.set_transform(make_pose(p=-p_WPs.mean(axis=0)))
    _draw_cloud(scene["cloud"], p_WPs)
    for name, pose_set in pose_sets.items():
        for band, colored in enumerate(score_bands(pose_set)):
            _draw_segments(scene[name][f"band_{band}"], colored)
    for helper in ("/Axes", "/Grid", "/Background"):
        visualizer[helper].set_property("visible", False)
    # In the axes of three.js, whose y is up.
    visualizer["/Cameras/default/rotated/<object>"].set_property("position", [0.18, 0.2, 0.18])
    return window.page("pose sets")


def main(options: ViewOptions) -> Path:
    """Write the page and return where it is."""
    pose_sets, p_WPs = load_pose_sets(options.file)
    best = {name: pose_set.head(options.best) for name, pose_set in pose_sets.items()}
    page = options.out or options.file.with_suffix(".html")
    write_atomically(page, render_page(best, p_WPs))
    for name, pose_set in best.items():
        top = f", best score {pose_set.scores[0]:.2f}" if len(pose_set) else ""
        print(f"{name}: {len(pose_set)} of {len(pose_sets[name])} poses{top}")
    print(f"wrote {page}")
    if options.open:
        webbrowser.open(page.resolve().as_uri())
    return page


if __name__ == "__main__":
    run_command(main, ViewOptions, __doc__)
