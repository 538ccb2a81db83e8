"""Saved pose sets as pages."""

import ast
import base64
import re
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
import umsgpack
from meshcat.visualizer import ViewerWindow

from scenarios.view_poses import ViewOptions, main, render_page
from scenarios.viewing.pose_drawing import (
    pose_segments,
    score_bands,
    score_color,
    sketch,
    thickened,
)
from split_drake.pose_set import PoseSet, save_pose_sets
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask, Symmetry
from split_drake.poses import Array, make_pose, rotation_x, rotation_z


def test_sketches_move_with_their_poses() -> None:
    X_WP = make_pose(rotation_z(0.5), (1.0, 2.0, 3.0))
    at_origin = pose_segments(GRASP, np.eye(4))
    moved = pose_segments(GRASP, X_WP)
    np.testing.assert_allclose(moved, at_origin @ X_WP[:3, :3].T + X_WP[:3, 3], atol=1e-12)


@pytest.mark.parametrize(
    ("symmetry", "R_same", "R_other"),
    [
        (Symmetry(), np.eye(3), rotation_x(np.pi)),
        (Symmetry.half_turn("x"), rotation_x(np.pi), rotation_x(np.pi / 2.0)),
        (Symmetry.any_turn("z"), rotation_z(np.pi / 8.0), rotation_x(np.pi)),
    ],
    ids=lambda value: value.kind if isinstance(value, Symmetry) else "",
)
def test_a_task_without_a_sketch_of_its_own_shows_its_symmetry(
    symmetry: Symmetry, R_same: Array, R_other: Array
) -> None:
    drawn = sketch(PoseTask("lid", symmetry))
    assert same_points(drawn @ R_same.T, drawn)
    assert not same_points(drawn @ R_other.T, drawn)


def test_thick_segments_are_not_where_thin_ones_are_alone() -> None:
    thin = pose_segments(GRASP, np.eye(4))
    copies = thickened(thin).reshape(7, *thin.shape)
    np.testing.assert_array_equal(copies[0], thin)
    np.testing.assert_allclose(copies.mean(axis=0), thin, atol=1e-12)
    away_m = np.linalg.norm(copies[1:] - thin, axis=-1)
    np.testing.assert_allclose(away_m, 0.001)
    assert len(np.unique(copies[:, 0, 0], axis=0)) == 7


def test_an_own_task_of_a_known_name_does_not_have_the_sketch_of_the_known_one() -> None:
    turning = Symmetry.any_turn("z")
    own = sketch(PoseTask("handle", turning))
    np.testing.assert_array_equal(own, sketch(PoseTask("lid", turning)))
    assert own.shape != sketch(HANDLE).shape
    np.testing.assert_array_equal(sketch(PoseTask("handle", HANDLE.symmetry)), sketch(HANDLE))


def same_points(one: Array, other: Array) -> bool:
    """Return whether segments (S, 2, 3) end in the same points as others (T, 2, 3)."""
    points = one.reshape(-1, 1, 3), other.reshape(1, -1, 3)
    apart = np.linalg.norm(points[0] - points[1], axis=-1)
    return bool(max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-9)


def test_bands_hold_every_pose_once() -> None:
    scores = np.array([0.0, 0.19, 0.5, 0.99, 1.0])
    pose_set = PoseSet.ranked(UPRIGHT, make_pose(p=np.zeros((5, 3))), scores)
    sketch = len(pose_segments(UPRIGHT, np.eye(4)))
    bands = list(score_bands(pose_set))
    assert [len(band.segments_W) // sketch for band in bands] == [2, 1, 2]
    assert bands[-1].color == score_color(0.9)


def test_a_saved_set_becomes_a_page(tmp_path: Path) -> None:
    pose_set = PoseSet.ranked(GRASP, np.eye(4)[None], np.array([0.7]))
    cloud = np.random.default_rng(0).normal(size=(50, 3))
    save_pose_sets(tmp_path / "poses.npz", {"grasp": pose_set}, cloud)
    page = main(ViewOptions(tmp_path / "poses.npz"))
    text = page.read_text()
    assert page == tmp_path / "poses.html"
    assert text.lstrip().lower().startswith("<!doctype html>")
    assert len(text) > 100_000  # the viewer is inside


def test_a_page_is_written_without_a_server_or_a_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a socket or a process was asked for")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr(ViewerWindow, "__init__", refuse)
    pose_set = PoseSet.ranked(GRASP, np.eye(4)[None], np.array([0.7]))
    save_pose_sets(tmp_path / "poses.npz", {"grasp": pose_set}, np.zeros((5, 3)))
    text = main(ViewOptions(tmp_path / "poses.npz")).read_text()
    shown = "".join(capfd.readouterr())
    assert "http" not in shown and "visit" not in shown
    assert "MeshCat.Viewer(" in text


def test_a_page_holds_what_was_drawn() -> None:
    cloud = np.array([[0.5, 0.0, 0.1], [0.5, 0.2, 0.1]])
    pose_set = PoseSet.ranked(GRASP, np.eye(4)[None], np.array([0.7]))
    page = render_page({"grasp": pose_set}, cloud)
    (listed,) = re.findall(r"for \(const text of (\[.*?\])\)", page)
    commands = [umsgpack.unpackb(base64.b64decode(text)) for text in ast.literal_eval(listed)]
    paths = [(each["type"], each["path"]) for each in commands]
    assert paths[0] == ("set_transform", "/meshcat/scene")
    assert ("set_object", "/meshcat/scene/cloud") in paths
    assert sum("/scene/grasp/band_" in path for _, path in paths) == 1
    moved = np.reshape(commands[0]["matrix"], (4, 4)).T
    np.testing.assert_allclose(moved[:3, 3], (-0.5, -0.1, -0.1))
    geometry = commands[1]["object"]["geometries"][0]["data"]["attributes"]["position"]["array"]
    np.testing.assert_allclose(np.frombuffer(geometry.data, np.float32), cloud.ravel())


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        main(ViewOptions(tmp_path / "nowhere.npz"))
