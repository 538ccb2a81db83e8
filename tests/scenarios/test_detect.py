"""Detection in images and clouds of a user."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenarios.detect import DetectOptions, main
from scenarios.making import examples
from split_drake.bad_input import BadInputError
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseSets, load_pose_sets
from split_drake.poses import Array, make_pose
from split_drake.sensing.cloud_file import read_cloud

EXAMPLES = MODELS_FOLDER / "examples"
DEPTH, CAMERAS = (EXAMPLES / "top.png", EXAMPLES / "side.png"), EXAMPLES / "cameras.yaml"
X_WO = examples.X_WO
# How far the best pose may be from the true one.
NEAR_M = 0.015


def true_handle() -> Array:
    return X_WO @ load_mug(examples.MUG).X_OH


def assert_found(pose_sets: PoseSets) -> None:
    p_WBest = {name: poses.X_WPs[0, :3, 3] for name, poses in pose_sets.items()}
    assert np.linalg.norm(p_WBest["upright"] - X_WO[:3, 3]) < NEAR_M
    assert np.linalg.norm(p_WBest["handle"] - true_handle()[:3, 3]) < NEAR_M
    assert len(pose_sets["grasp"]) > 30


def test_the_examples_are_what_their_command_makes(tmp_path: Path) -> None:
    examples.main(examples.ExamplesOptions(tmp_path))
    for shipped in EXAMPLES.iterdir():
        made = tmp_path / shipped.name
        if shipped.suffix == ".png":
            np.testing.assert_array_equal(Image.open(made), Image.open(shipped))
        else:
            assert made.read_bytes() == shipped.read_bytes()


def test_images_give_pose_sets_a_table_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(DetectOptions(DEPTH, CAMERAS, out=tmp_path))
    pose_sets, cloud = load_pose_sets(tmp_path / "pose_sets.npz")
    assert_found(pose_sets)
    assert len(cloud) > 5000
    (found,) = json.loads((tmp_path / "pose_sets.json").read_text())["objects"]
    np.testing.assert_allclose(found["pose_sets"]["handle"]["X_WPs"], pose_sets["handle"].X_WPs)
    assert found["points"] == pytest.approx(len(cloud), rel=0.1)
    page, told = (tmp_path / "index.html").read_text(), capsys.readouterr().out
    for name, poses in pose_sets.items():
        assert f"<td>{name}</td><td>{len(poses)}</td><td>{poses.scores[0]:.2f}</td>" in page
        assert re.search(rf"{name} +│ {len(poses)} +│ {poses.scores[0]:.2f}", told)
    for file in ("picture.png", "poses.html", "pose_sets.npz", "pose_sets.json"):
        assert f'"{file}"' in page
        assert (tmp_path / file).stat().st_size > 1000
    assert np.asarray(Image.open(tmp_path / "picture.png")).std() > 10.0


def test_a_folder_of_something_else_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    with pytest.raises(BadInputError, match="it is no folder of an earlier run"):
        main(DetectOptions(cloud=EXAMPLES / "scene.ply", out=tmp_path))
    assert (tmp_path / "index.html").read_text() == "mine"


def test_a_cloud_gives_the_same(tmp_path: Path) -> None:
    main(DetectOptions(cloud=EXAMPLES / "scene.ply", out=tmp_path))
    assert_found(load_pose_sets(tmp_path / "pose_sets.npz")[0])


def test_a_moved_cloud_is_found_around_its_center(tmp_path: Path) -> None:
    moved = read_cloud(EXAMPLES / "scene.ply") + np.array([-0.2, 0.3, 0.7])
    np.save(tmp_path / "moved.npy", moved)
    main(DetectOptions(cloud=tmp_path / "moved.npy", center=(0.3, 0.3, 0.7), out=tmp_path / "out"))
    pose_sets, _ = load_pose_sets(tmp_path / "out/pose_sets.npz")
    back = make_pose(p=(0.2, -0.3, -0.7))
    assert_found({name: poses.moved(back) for name, poses in pose_sets.items()})


def test_what_fits_no_task_is_empty_with_a_reason(tmp_path: Path) -> None:
    """A small ball: no handle, and nothing that would stand."""
    directions = np.random.default_rng(0).normal(size=(4000, 3))
    ball = 0.02 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.save(tmp_path / "ball.npy", ball + np.array([0.5, 0.0, 0.02]))
    main(DetectOptions(cloud=tmp_path / "ball.npy", tasks=("handle",), out=tmp_path / "out"))
    handles = load_pose_sets(tmp_path / "out/pose_sets.npz")[0]["handle"]
    assert len(handles) == 0
    assert "of 256 poses drawn was accepted: the best has a score of" in handles.reason
    assert handles.reason in (tmp_path / "out/index.html").read_text()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "expected either --depth images with --camera, or a --cloud"),
        ({"depth": DEPTH, "cloud": CAMERAS, "camera": CAMERAS}, "expected either --depth"),
        ({"depth": DEPTH}, "--depth and --camera go together"),
        ({"cloud": CAMERAS, "camera": CAMERAS}, "--depth and --camera go together"),
        ({"depth": DEPTH, "camera": CAMERAS, "mask": DEPTH[:1]}, "--mask names 1 images"),
        ({"cloud": CAMERAS, "tasks": ()}, "expected one at least"),
        ({"cloud": CAMERAS, "seed": -1}, "--seed is -1"),
        ({"cloud": CAMERAS, "center": (0.0, float("nan"), 0.0)}, "--center is nan"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options: dict[str, object], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        main(DetectOptions(**options))  # type: ignore[arg-type]


def test_images_and_cameras_must_be_as_many(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"has 2 cameras, --depth names 1 images"):
        main(DetectOptions(DEPTH[:1], CAMERAS, out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_file_called_models_beside_the_script_changes_nothing(tmp_path: Path) -> None:
    (tmp_path / "models.py").write_text("raise RuntimeError('the wrong models')\n")
    code = (
        "from split_drake.split.detector import SplitDetector\n"
        "from split_drake.objects.mugs.split import load_mug\n"
        "from planning.problem_files import SHIPPED_PROBLEMS\n"
        "load_mug('test_004'); SplitDetector.from_checkpoint(); assert SHIPPED_PROBLEMS.is_file()\n"
    )
    (tmp_path / "script.py").write_text(code)
    subprocess.run([sys.executable, str(tmp_path / "script.py")], check=True, cwd=tmp_path)
