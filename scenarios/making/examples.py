"""The images and clouds of `models/examples`: `python -m scenarios.making.examples`.

Two depth cameras look at a mug that the model was not trained on, standing on a table.
"""

import io
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from split_drake.bad_input import require_numbers
from split_drake.camera import DepthView
from split_drake.data.render import DepthRenderer
from split_drake.depth_noise import DEPTH_NOISE
from split_drake.experiments.command import run_command
from split_drake.files import write_atomically
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import make_pose, rotation_z
from split_drake.sensing.depth_file import MILLIMETRE_M
from split_drake.station.layout import Layout

MUG = "test_004"
X_WO = make_pose(rotation_z(0.6), (0.5, 0.0, 0.0))
# Every so many pixels along both sides of an image one point of the cloud.
_STRIDE = 3


@dataclass(frozen=True)
class ExamplesOptions:
    """Write example images, their cameras and a cloud.

    Attributes:
        out: folder that they are written to.
        seed: of the cameras' noise.
    """

    out: Path = MODELS_FOLDER / "examples"
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)


def _views(seed: int) -> list[DepthView]:
    renderer = DepthRenderer(load_mug(MUG).body.mesh)
    noise, rng = DEPTH_NOISE["low"], np.random.default_rng(seed)
    assert noise is not None

    return [noise.seen(renderer.render(X_WO, camera), rng) for camera in Layout().cameras]


def _png(view: DepthView) -> bytes:
    buffer = io.BytesIO()
    counts = np.rint(view.depth_m / MILLIMETRE_M).astype(np.uint16)
    Image.fromarray(counts).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def _camera_info(view: DepthView) -> str:
    """Return the calibration as ROS's camera_calibration writes it."""
    camera = view.intrinsics
    data = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    return (
        f"image_width: {camera.width}\nimage_height: {camera.height}\ncamera_name: top\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {data}\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.0, 0.0, 0.0, 0.0, 0.0]\n"
    )


def _cameras(top: DepthView, side: DepthView) -> str:
    rows = "\n".join(f"      - {json.dumps(row)}" for row in top.X_WC.round(6).tolist())
    position = side.X_WC[:3, 3].round(6).tolist()
    return (
        "# What may stand here is told in split_drake/sensing/camera_file.py.\n"
        "cameras:\n"
        "  - name: top\n    intrinsics: camera_info.yaml\n"
        f"    X_WC:  # x right, y down, z into the scene\n{rows}\n"
        f"  - name: side\n    intrinsics: {json.dumps(asdict(side.intrinsics))}\n"
        f"    look_at: {{position: {position}, target: [0.5, 0.0, 0.0]}}\n"
        "workspace: {center: [0.5, 0.0, 0.0]}\n"
    )


def _cloud(views: list[DepthView]) -> bytes:
    kept = []
    for view in views:
        thinned = np.ones(view.depth_m.shape, dtype=bool)
        thinned[::_STRIDE, ::_STRIDE] = False
        kept.append(view.masked(thinned).points())
    cloud = trimesh.PointCloud(np.concatenate(kept).astype(np.float32))
    return bytes(cloud.export(file_type="ply"))


def main(options: ExamplesOptions) -> None:
    """Write the files."""
    top, side = views = _views(options.seed)
    write_atomically(options.out / "top.png", _png(top))
    write_atomically(options.out / "side.png", _png(side))
    write_atomically(options.out / "camera_info.yaml", _camera_info(top))
    write_atomically(options.out / "cameras.yaml", _cameras(top, side))
    write_atomically(options.out / "scene.ply", _cloud(views))
    for file in sorted(options.out.iterdir()):
        print(f"{file}: {file.stat().st_size / 1000.0:.0f} kB")


if __name__ == "__main__":
    run_command(main, ExamplesOptions, __doc__)
