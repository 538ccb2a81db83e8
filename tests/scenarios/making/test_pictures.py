"""The commands that make pictures: true poses of a mug, moments of a recording."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scenarios.making import clutter_picture, picture, pose_kinds
from scenarios.viewing.pose_drawing import score_color
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import GRASP, HANDLE, MUG_TASKS
from split_drake.poses import make_pose, rotation_x
from tests.helpers.checkpoints import save_new_network

LYING = make_pose(rotation_x(-np.pi / 2.0), (0.5, 0.0, 0.05))


def test_true_poses_are_of_each_task_and_the_steepest_grasp_comes_first() -> None:
    mug = load_mug("test_004")
    poses = dict(pose_kinds.true_poses(mug, LYING, seed=0))
    assert tuple(poses) == MUG_TASKS
    steepness = -poses[GRASP][:, 2, 2]
    assert len(steepness) == 3 and (np.diff(steepness) <= 0.0).all() and steepness[-1] > 0.0
    p_OGs = np.linalg.solve(LYING, poses[GRASP])[:, :3, 3]
    lower, upper = mug.body.mesh.bounds
    assert ((p_OGs > lower - 0.02) & (p_OGs < upper + 0.02)).all()
    np.testing.assert_allclose(poses[HANDLE], mug.true_poses(HANDLE, LYING))


def test_a_picture_of_poses_is_written_and_shows_them(tmp_path: Path) -> None:
    out = tmp_path / "folder" / "poses.png"
    pose_kinds.main(pose_kinds.PictureOptions(out=out))
    picture_rgb = np.asarray(Image.open(out).convert("RGB")).astype(int)
    assert picture_rgb.shape == (370, 1200, 3)
    orange = (np.abs(picture_rgb - (255, 152, 0)) < 8).all(axis=-1)
    drawn = [third.sum() for third in np.array_split(orange, 3, axis=1)]
    assert min(drawn) > 20, "poses of each task"


def test_a_picture_of_clutter_shows_grasps_in_both_scenes(tmp_path: Path) -> None:
    checkpoint, out = tmp_path / "new.safetensors", tmp_path / "clutter.png"
    save_new_network(checkpoint, tasks=(GRASP,))
    options = clutter_picture.PictureOptions(checkpoint, out, seed=3, shown=5)
    clutter_picture.main(options)
    picture_rgb = np.asarray(Image.open(out).convert("RGB")).astype(int)
    assert picture_rgb.shape == (460, 1200, 3)
    halves = np.array_split(picture_rgb, 2, axis=1)
    assert (halves[0] != halves[1]).any(axis=-1).mean() > 0.02, "two scenes"
    band = 255 * np.array(score_color(0.5))
    drawn = [(np.abs(half - band) < 12).all(axis=-1).sum() for half in halves]
    assert min(drawn) > 20, "grasps of a middling score in each"
    with pytest.raises(ValueError, match="--shown is 0; expected 1 or more"):
        replace(options, shown=0)
    with pytest.raises(ValueError, match=r"--checkpoint: there is no file nowhere"):
        replace(options, checkpoint=Path("nowhere"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"moments": ()}, r"moments are \(\); expected numbers from 0 to 1"),
        ({"moments": (0.5, 1.1)}, r"moments are \(0\.5, 1\.1\)"),
        ({"moments": (-0.1,)}, r"moments are \(-0\.1,\)"),
        ({"recording": Path("nowhere.html")}, "there is no recording nowhere.html"),
    ],
)
def test_moments_and_recordings_that_are_not_there_are_named(
    options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    recording = tmp_path / "000.html"
    recording.touch()
    with pytest.raises(ValueError, match=message):
        picture.PictureOptions(**{"recording": recording, "out": tmp_path / "a.png", **options})


def test_without_chromium_its_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "000.html").touch()
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(FileNotFoundError, match="apt-get install -y chromium"):
        picture.main(picture.PictureOptions(tmp_path / "000.html", out=tmp_path / "a.png"))
    assert not (tmp_path / "a.png").exists()


def test_moments_are_put_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "000.html").touch()
    colors = [(200, 0, 0), (0, 200, 0)]
    shots = [Image.new("RGB", (30, 20), color) for color in colors]
    monkeypatch.setattr(picture, "capture_moments", lambda options: shots)
    out = tmp_path / "a.png"
    picture.main(picture.PictureOptions(tmp_path / "000.html", out, (0.0, 1.0), size_px=(30, 20)))
    sheet = Image.open(out)
    assert sheet.size == (60, 20)
    assert [sheet.getpixel((x, 10)) for x in (5, 55)] == colors
