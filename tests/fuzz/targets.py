"""What is fuzzed: each target makes one odd input, uses it, and checks what comes of it.

A target returns where the input was fine and the result is right, and raises ValueError with one
sentence where the input cannot be used.  All else is a fault.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from planning.plan_rows import export_rows, import_rows
from planning.problem import rows_of
from planning.problem_files import load_problems, save_problems
from planning.subgoal import find_subgoal
from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.files import read_json_object
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects_in_view import objects_in_view
from split_drake.pose_set import PoseSet, load_pose_sets, save_pose_sets
from split_drake.pose_task import GRASP, HANDLE
from split_drake.poses import Array, make_pose
from split_drake.scene import Scene, Workspace
from split_drake.sensing.calibration_file import read_calibration
from split_drake.sensing.camera_file import read_cameras
from split_drake.sensing.cloud_file import read_cloud
from split_drake.sensing.depth_file import read_depth, read_mask
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import read_station, station_to_yaml
from split_drake.station.layout import Layout
from tests.fuzz.mutations import damaged, mutated, odd_array, pick
from tests.helpers.planning import STANDING, mug_problem, reorient_plan

EXAMPLES, STATIONS = MODELS_FOLDER / "examples", MODELS_FOLDER / "stations"
Rng = np.random.Generator


@dataclass(frozen=True)
class Target:
    """Something to fuzz: `run` takes a folder for files and what chance is drawn from."""

    name: str
    run: Callable[[Path, Rng], None]


def require(good: Any, what: str) -> None:
    """Raise AssertionError, which no input may cause, where a result is not as it should be."""
    if not np.all(good):
        raise AssertionError(what)


def require_pose(X: Array, what: str) -> None:
    R = X[..., :3, :3]
    require(np.isfinite(X), f"{what} is not finite")
    require(np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)) < 2e-4, f"{what} is no rotation")


def depth_view(_: Path, rng: Rng) -> None:
    shape = (24, 32) if rng.random() < 0.9 else tuple(int(n) for n in rng.integers(0, 40, 2))
    depth = odd_array(shape, 0.5, rng)
    if depth.dtype.kind in "fi" and rng.random() < 0.7:
        depth = np.abs(depth)
    X_WC = look_at((0.5, 0.1, 0.6), (0.5, 0.0, 0.0))
    if rng.random() < 0.4:
        X_WC = X_WC + rng.normal(0.0, 10.0 ** rng.uniform(-6, 0), (4, 4))
    view = DepthView(depth, Intrinsics.centered(32, 24, 30.0), X_WC)
    require_pose(view.X_WC, "X_WC")
    require(np.isfinite(view.depth_m) & (view.depth_m >= 0.0), "depth is not finite")
    points = view.points()
    require(np.isfinite(points), "points are not finite")
    require(len(points) == np.count_nonzero(view.depth_m), "a pixel is lost")


def intrinsics(_: Path, rng: Rng) -> None:
    if rng.random() < 0.5:
        K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
        K[tuple(rng.integers(0, 3, 2))] = rng.choice([0.0, -1.0, np.nan, np.inf, 3.0])
        made = Intrinsics.from_matrix(K, (640, 480))
    else:
        numbers = mutated([640, 480, 500.0, 500.0, 320.0, 240.0], rng)
        if not isinstance(numbers, list) or len(numbers) != 6:
            raise ValueError("not six")
        made = Intrinsics(*numbers)
    require(np.isfinite([made.fx, made.fy, made.cx, made.cy]), "intrinsics are not finite")
    require(min(made.fx, made.fy, made.width, made.height) > 0, "intrinsics are not positive")


def scene(_: Path, rng: Rng) -> None:
    points = odd_array((int(rng.integers(1, 400)), 3), 0.1, rng)
    if points.dtype.kind == "f" and points.ndim == 2 and points.shape[1] == 3:
        points = points + np.array([0.5, 0.0, 0.05], dtype=points.dtype)
    workspace = Workspace()
    made = Scene.from_points(points, workspace)
    given = np.asarray(points, dtype=float)
    inside = np.isfinite(given).all(axis=1)
    with np.errstate(invalid="ignore"):
        inside &= (np.abs(given[:, :2] - [0.5, 0.0]) <= 0.15).all(axis=1)
        inside &= (given[:, 2] > 0.004) & (given[:, 2] < 0.25)
    require(abs(len(made.p_WPs) - inside.sum()) <= 1, "the crop is wrong")
    require(made.p_WSs.shape == (Scene.SAMPLED_POINTS, 3), "samples are missing")
    require(made.grid().sum() <= len(made.p_WPs), "there are more voxels than points")
    parts = objects_in_view(made.p_WPs)
    require(sum(len(part.p_WPs) for part in parts) <= len(made.p_WPs), "points are doubled")


def workspace(_: Path, rng: Rng) -> None:
    fields = mutated({"p_WCenter": [0.5, 0.0, 0.0], "edge_m": 0.3, "depth_below_m": 0.05}, rng)
    if not isinstance(fields, dict) or not all(isinstance(key, str) for key in fields):
        raise ValueError("no fields")
    if {*fields} - {"p_WCenter", "edge_m", "depth_below_m"} or "p_WCenter" not in fields:
        raise ValueError("other fields")
    if not isinstance(fields["p_WCenter"], list):
        raise ValueError("no center")
    made = Workspace.from_fields(fields)
    require(np.isfinite([*made.p_WCenter, made.edge_m, made.depth_below_m]), "not finite")
    require(made.edge_m > made.depth_below_m >= 0.0 or made.depth_below_m < 0.0, "no cube")


def pose_set(_: Path, rng: Rng) -> None:
    count = int(rng.integers(0, 5))
    poses = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    if rng.random() < 0.6 and count:
        poses += rng.normal(0.0, 10.0 ** rng.uniform(-8, 0), poses.shape)
    if rng.random() < 0.2:
        poses = odd_array((count, 4, 4), 1.0, rng)
    scores = odd_array((count,), 0.5, rng) if rng.random() < 0.4 else rng.random(count)
    made = PoseSet.ranked(GRASP, poses, scores)
    require(len(made) == len(poses), "poses are lost")
    require(np.diff(made.scores) <= 0.0, "scores do not descend")
    require((made.scores >= 0.0) & (made.scores <= 1.0), "scores are out of range")
    require_pose(made.X_WPs, "a pose")


@cache
def _pose_sets_npz(folder: Path) -> bytes:
    sets = {
        GRASP.name: PoseSet(GRASP, make_pose(p=np.ones((3, 3))), np.array([0.9, 0.8, 0.1])),
        HANDLE.name: PoseSet(HANDLE, np.empty((0, 4, 4)), np.empty(0), "none was found"),
    }
    save_pose_sets(folder / "good.npz", sets, np.ones((50, 3)))
    return (folder / "good.npz").read_bytes()


def pose_set_file(folder: Path, rng: Rng) -> None:
    file = folder / "poses.npz"
    if rng.random() < 0.6:
        file.write_bytes(damaged(_pose_sets_npz(folder), rng))
    else:
        with np.load(io.BytesIO(_pose_sets_npz(folder))) as good:
            arrays = {name: good[name] for name in good.files}
        name = pick(rng, tuple(arrays))
        arrays[name] = odd_array(arrays[name].shape, 1.0, rng)
        np.savez(file, **arrays)
    sets, cloud = load_pose_sets(file)
    require(cloud.ndim == 2 and cloud.shape[1] == 3 and np.isfinite(cloud).all(), "no cloud")
    for each in sets.values():
        require_pose(each.X_WPs, "a pose")


def _yaml_file(source: Path) -> Callable[[Path, Rng], Path]:
    tree = yaml.safe_load(source.read_text())

    def written(folder: Path, rng: Rng) -> Path:
        file = folder / source.name
        (folder / "camera_info.yaml").write_bytes((EXAMPLES / "camera_info.yaml").read_bytes())
        if rng.random() < 0.3:
            file.write_bytes(damaged(source.read_bytes(), rng))
        else:
            file.write_text(yaml.safe_dump(mutated(tree, rng)))
        return file

    return written


_CAMERAS, _INFO = _yaml_file(EXAMPLES / "cameras.yaml"), _yaml_file(EXAMPLES / "camera_info.yaml")
_DEFAULT, _HIGH = (_yaml_file(STATIONS / f"{name}.yaml") for name in ("default", "high_table"))


def cameras(folder: Path, rng: Rng) -> None:
    file = read_cameras(_CAMERAS(folder, rng))
    for camera in file.cameras:
        require_pose(camera.X_WC, "X_WC")
        require(0.0 < camera.unit_m < np.inf, "the unit is none")


def calibration(folder: Path, rng: Rng) -> None:
    camera = read_calibration(_INFO(folder, rng)).intrinsics
    require(np.isfinite([camera.fx, camera.fy, camera.cx, camera.cy]), "not finite")
    require(min(camera.fx, camera.fy) > 0.0, "focal lengths are not positive")


def station(folder: Path, rng: Rng) -> None:
    usual = StationConfig(Layout())
    made = read_station(pick(rng, (_DEFAULT, _HIGH))(folder, rng), usual)
    written = station_to_yaml(made)
    (folder / "again.yaml").write_text(written)
    require(station_to_yaml(read_station(folder / "again.yaml", usual)) == written, "it changed")
    require_pose(made.layout.X_WK, "X_WK")


def depth_file(folder: Path, rng: Rng) -> None:
    counts = rng.integers(0, 65536, (20, 30)).astype(np.uint16)
    suffix = pick(rng, (".png", ".tiff", ".npy"))
    buffer, file = io.BytesIO(), folder / f"depth{suffix}"
    if suffix == ".npy":
        np.save(buffer, odd_array((20, 30), 1.0, rng))
    else:
        Image.fromarray(counts).save(buffer, suffix[1:])
    file.write_bytes(damaged(buffer.getvalue(), rng))
    depth = read_depth(file, float(rng.choice([0.001, 0.0001, 0.0, -1.0, np.nan])))
    require(depth.ndim == 2 and depth.dtype == np.float32, "no image")
    require(np.isfinite(depth), "depth is not finite")


def mask_file(folder: Path, rng: Rng) -> None:
    buffer, file = io.BytesIO(), folder / "mask.png"
    Image.fromarray(rng.integers(0, 2, (20, 30)).astype(np.uint8)).save(buffer, "png")
    file.write_bytes(damaged(buffer.getvalue(), rng))
    mask = read_mask(file)
    require(mask.ndim == 2 and mask.dtype == bool, "no mask")


def cloud_file(folder: Path, rng: Rng) -> None:
    suffix, points = pick(rng, (".ply", ".pcd", ".npy", ".npz")), rng.normal(size=(30, 3))
    buffer = io.BytesIO()
    if suffix == ".npz":
        np.savez(buffer, cloud=odd_array((30, 3), 1.0, rng))
    elif suffix == ".npy":
        np.save(buffer, odd_array((30, 3), 1.0, rng))
    else:
        buffer.write(_ASCII[suffix].encode())
        np.savetxt(buffer, points, fmt="%.5f")
    file = folder / f"cloud{suffix}"
    file.write_bytes(damaged(buffer.getvalue(), rng))
    cloud = read_cloud(file)
    require(cloud.ndim == 2 and cloud.shape[1] == 3 and cloud.dtype == float, "no cloud")


_ASCII = {
    ".ply": "ply\nformat ascii 1.0\nelement vertex 30\nproperty float x\nproperty float y\n"
    "property float z\nend_header\n",
    ".pcd": "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    "WIDTH 30\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 30\nDATA ascii\n",
}


@cache
def _problems(folder: Path) -> bytes:
    problem = mug_problem(find_subgoal("hang"), STANDING)
    save_problems(folder / "good_problems.npz", {"one": problem})
    return (folder / "good_problems.npz").read_bytes()


def problem_file(folder: Path, rng: Rng) -> None:
    file = folder / "problems.npz"
    file.write_bytes(damaged(_problems(folder), rng))
    for problem in load_problems(file).values():
        require(np.isfinite(problem.p_WPs), "the cloud is not finite")


def plan_rows(folder: Path, rng: Rng) -> None:
    suffix = pick(rng, (".csv", ".json", ".json", ".json"))  # CSV is not read, only refused
    good, file = folder / f"good_plan{suffix}", folder / f"plan{suffix}"
    if not good.exists():
        export_rows(good, rows_of(reorient_plan().segments)[:20])
    if suffix == ".json" and rng.random() < 0.5:
        tree = mutated(read_json_object(good, "a plan"), rng)
        file.write_text(yaml.safe_dump(tree, default_flow_style=True))
    else:
        file.write_bytes(damaged(good.read_bytes(), rng))
    for row in import_rows(file):
        require(np.isfinite([row.time_s, row.opening_m, *row.q]), "a row is not finite")


TARGETS = tuple(
    Target(run.__name__, run)
    for run in (
        depth_view,
        intrinsics,
        scene,
        workspace,
        pose_set,
        pose_set_file,
        cameras,
        calibration,
        station,
        depth_file,
        mask_file,
        cloud_file,
        problem_file,
        plan_rows,
    )
)
