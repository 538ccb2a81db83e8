"""Pose sets of your own depth images, or of your own cloud: `python -m scenarios.detect --help`.

Each object in view is looked at alone.  The output folder holds pose_sets.npz (for
`split_drake.pose_set.load_pose_sets` and `scenarios.view_poses`), pose_sets.json (by object),
picture.png, poses.html (the cloud and the poses, to be turned) and index.html.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from scenarios import view_poses
from scenarios.detecting.found import FoundObject, find_poses
from scenarios.detecting.pictures import picture
from scenarios.viewing import page
from split_drake.bad_input import BadInputError, require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.run import claim_folder
from split_drake.files import write_atomically, write_json
from split_drake.pose_set import merged_pose_sets, save_pose_sets
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.sensing.camera_file import read_cameras
from split_drake.sensing.cloud_file import read_cloud
from split_drake.sensing.scene_report import measured_points, report_of
from split_drake.sensing.table_noise import above_noise_of, above_table_noise, scene_above_noise

_HEADS = ("object", "middle (m)", "task", "poses", "best score", "why none")


@dataclass(frozen=True)
class DetectOptions:
    """Find grasps, handles and upright poses of what stands on a table.

    Attributes:
        depth: depth images: PNG or TIFF of 16 bits in millimetres (or the camera's `unit_m`), TIFF
            or NPY of floats in metres.
        camera: a YAML file of the cameras that took them, in their order; see
            split_drake/sensing/camera_file.py.
        mask: an image for each depth image, not 0 where nothing is to be seen, a robot's arm say.
        cloud: in place of images, a PLY, PCD, NPY or NPZ of points in metres, table included, z up.
        center: of the cube of 30 cm that is looked at: the middle of its footprint on the table;
            where not given that of the file of cameras, or else 0.5 0 0.
        tasks: that poses are wanted of.
        checkpoint: weights of SPLIT; those that ship with the project where not given.
        seed: of the samples.
        out: folder of the results; runs/detect/<time> where not given.
    """

    depth: tuple[Path, ...] = ()
    camera: Path | None = None
    mask: tuple[Path, ...] = ()
    cloud: Path | None = None
    center: tuple[float, float, float] | None = None
    tasks: tuple[str, ...] = ("grasp", "handle", "upright")
    checkpoint: Path | None = None
    seed: int = 0
    out: Path | None = None

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)

    def require_sources(self) -> None:
        """Raise BadInputError where options do not go together, or one is missing."""
        if bool(self.depth) == (self.cloud is not None):
            raise BadInputError("expected either --depth images with --camera, or a --cloud")
        if bool(self.depth) != (self.camera is not None):
            raise BadInputError("--depth and --camera go together: expected both or none")
        if self.mask and len(self.mask) != len(self.depth):
            raise BadInputError(
                f"--mask names {len(self.mask)} images, --depth {len(self.depth)}; expected a mask "
                "for each, or none"
            )
        if not self.tasks or len(set(self.tasks)) < len(self.tasks):
            raise BadInputError(f"--tasks are {list(self.tasks)}; expected one at least, each once")


@dataclass(frozen=True)
class SeenScene:
    """What the files show.

    Attributes:
        scene: of it.
        measured: (N, 3) all points that were measured, in W.
        counted: the workspace with the clearance up to which they counted as table.
    """

    scene: Scene
    measured: Array
    counted: Workspace


def read_scene(options: DetectOptions) -> SeenScene:
    """Return the scene that the files show.

    Raises BadInputError where a file cannot be used, and EmptySceneError where none shows anything
    in the workspace.
    """
    if options.cloud is not None:
        points = read_cloud(options.cloud)
        workspace = _workspace(options, None)
        counted = above_noise_of(workspace, points)
        scene = Scene.from_points(points, counted)
        return SeenScene(replace(scene, workspace=workspace), points, counted)
    assert options.camera is not None
    file = read_cameras(options.camera)
    if len(file.cameras) != len(options.depth):
        raise BadInputError(
            f"{options.camera} has {len(file.cameras)} cameras, --depth names "
            f"{len(options.depth)} images; expected one for each"
        )
    masks = options.mask or (None,) * len(options.depth)
    shots = zip(file.cameras, options.depth, masks, strict=True)
    views = [camera.view(image, mask) for camera, image, mask in shots]
    workspace = _workspace(options, file.workspace)
    scene, counted = scene_above_noise(views, workspace), above_table_noise(workspace, views)
    return SeenScene(scene, measured_points(views), counted)


def _workspace(options: DetectOptions, of_file: Workspace | None) -> Workspace:
    workspace = of_file or Workspace()
    return workspace if options.center is None else replace(workspace, p_WCenter=options.center)


def _rows(found: list[FoundObject]) -> Iterator[tuple[str, ...]]:
    for index, each in enumerate(found):
        middle = " ".join(f"{x:.3f}" for x in each.p_WMiddle)
        for name, poses in each.pose_sets.items():
            best = f"{poses.scores[0]:.2f}" if len(poses) else ""
            yield str(index + 1), middle, name, str(len(poses)), best, poses.reason


def _write(out: Path, scene: Scene, found: list[FoundObject], facts: list[str]) -> None:
    pose_sets = merged_pose_sets([each.pose_sets for each in found])
    save_pose_sets(out / "pose_sets.npz", pose_sets, scene.p_WPs)
    write_json(out / "pose_sets.json", {"facts": facts, "objects": [o.fields() for o in found]})
    write_atomically(out / "picture.png", picture(scene, pose_sets))
    best = {name: poses.head(view_poses.BEST) for name, poses in pose_sets.items()}
    write_atomically(out / "poses.html", view_poses.render_page(best, scene.p_WPs))
    files = ("poses.html", "pose_sets.npz", "pose_sets.json")
    after = [
        page.picture("picture.png", "found poses, red to green by score"),
        *(f"<p>{page.link(name, name)}</p>" for name in files),
    ]
    rows = [[page.text(cell) for cell in row] for row in _rows(found)]
    write_atomically(
        out / "index.html", page.table_page("What was found", facts, _HEADS, rows, after)
    )


def _asked(options: DetectOptions) -> dict[str, str]:
    """Return the options that say what is detected in what."""
    return {name: str(value) for name, value in vars(options).items() if name != "out"}


def main(options: DetectOptions) -> Path:
    """Find poses, write them, and return the folder that they are in."""
    options.require_sources()
    # PyTorch takes a second to load.
    from split_drake.split.detector import single_threaded_detector

    seen = read_scene(options)
    detector = single_threaded_detector(options.checkpoint)
    found = find_poses(seen.scene, detector, options.tasks, np.random.default_rng(options.seed))
    facts = report_of(seen.scene, seen.measured, seen.counted).facts()
    out = options.out or Path("runs/detect") / time.strftime("%Y%m%d-%H%M%S")
    with claim_folder(out, {"detect": _asked(options)}):
        _write(out, seen.scene, found, facts)
    console = Console(soft_wrap=True)
    for fact in facts:
        console.print(fact)
    table = Table(*_HEADS)
    for row in _rows(found):
        table.add_row(*row)
    console.print(table)
    console.print(f"wrote {out / 'index.html'}")
    return out


if __name__ == "__main__":
    run_command(main, DetectOptions, __doc__)
