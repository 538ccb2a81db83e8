"""Depth images, masks and clouds from files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pypcd4 import PointCloud

from split_drake.bad_input import BadInputError
from split_drake.files import MissingFileError, UnreadableFileError
from split_drake.sensing.cloud_file import read_cloud
from split_drake.sensing.depth_file import read_depth, read_mask

DEPTH_M = np.array([[0.5, 0.612, 0.0], [1.25, 0.0, 0.75]], dtype=np.float32)
POINTS = np.array([[0.5, 0.0, 0.05], [0.52, 0.01, 0.08], [np.nan] * 3, [0.45, -0.1, 0.02]])


def millimetres(file: Path) -> None:
    counts = np.rint(DEPTH_M * 1000.0).astype(np.uint16)
    counts[1, 1] = 65535
    Image.fromarray(counts).save(file)


def float_metres(file: Path) -> None:
    Image.fromarray(np.where(DEPTH_M > 0.0, DEPTH_M, np.nan)).save(file)


def array(file: Path) -> None:
    np.save(file, np.where(DEPTH_M > 0.0, DEPTH_M, np.inf))


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.png", millimetres),
        ("a.tiff", millimetres),
        ("b.tiff", float_metres),
        ("a.npy", array),
    ],
)
def test_depth_of_all_kinds_is_the_same(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    write(tmp_path / name)
    depth = read_depth(tmp_path / name)
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, DEPTH_M, atol=1e-6)


def test_the_unit_is_that_which_is_said(tmp_path: Path) -> None:
    millimetres(tmp_path / "a.png")
    np.testing.assert_allclose(read_depth(tmp_path / "a.png", 0.0002), 0.2 * DEPTH_M, atol=1e-6)
    with pytest.raises(BadInputError, match=r"the unit of depth is 0\.0; expected a number from"):
        read_depth(tmp_path / "a.png", 0.0)


def test_pictures_are_no_depth(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((4, 5, 3), np.uint8)).save(tmp_path / "color.png")
    with pytest.raises(BadInputError, match="is it a picture in colour"):
        read_depth(tmp_path / "color.png")
    Image.fromarray(np.zeros((4, 5), np.uint8)).save(tmp_path / "gray.png")
    with pytest.raises(BadInputError, match="has 8 bits a pixel"):
        read_depth(tmp_path / "gray.png")
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(UnreadableFileError, match=r"text\.png is damaged or not a depth image"):
        read_depth(tmp_path / "text.png")
    with pytest.raises(MissingFileError, match="there is no file"):
        read_depth(tmp_path / "none.png")


def test_truncated_images_are_told(tmp_path: Path) -> None:
    file = tmp_path / "a.png"
    Image.fromarray(np.arange(10000, dtype=np.uint16).reshape(100, 100)).save(file)
    whole = file.read_bytes()
    for length in range(0, len(whole) - 12, 97):
        file.write_bytes(whole[:length])
        with pytest.raises(UnreadableFileError, match=r"a\.png"):
            read_depth(file)


def test_masks_are_what_is_not_black(tmp_path: Path) -> None:
    mask = np.array([[0, 1, 255], [0, 0, 7]], np.uint8)
    Image.fromarray(mask).save(tmp_path / "gray.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "gray.png"), mask > 0)
    Image.fromarray(np.stack([0 * mask, mask, 0 * mask], axis=-1)).save(tmp_path / "green.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "green.png"), mask > 0)
    np.save(tmp_path / "mask.npy", mask > 0)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.npy"), mask > 0)
    np.save(tmp_path / "line.npy", mask[0] > 0)
    with pytest.raises(BadInputError, match=r"shape \(3,\) and type bool; expected a mask"):
        read_mask(tmp_path / "line.npy")


def ply(file: Path) -> None:
    trimesh.PointCloud(POINTS).export(file)


def pcd(file: Path) -> None:
    PointCloud.from_xyz_points(POINTS.astype(np.float32)).save(file)


def npy(file: Path) -> None:
    np.save(file, POINTS)


def organized(file: Path) -> None:
    np.save(file, POINTS.reshape(2, 2, 3))


def npz(file: Path) -> None:
    np.savez(file, points=POINTS, colors=np.zeros((4, 3)))


@pytest.mark.parametrize(
    ("name", "write"),
    [("a.ply", ply), ("a.pcd", pcd), ("a.npy", npy), ("b.npy", organized), ("a.npz", npz)],
)
def test_clouds_of_all_kinds_are_the_same(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    write(tmp_path / name)
    np.testing.assert_allclose(read_cloud(tmp_path / name), POINTS, atol=1e-6)


@pytest.mark.parametrize(("name", "write"), [("a.ply", ply), ("a.pcd", pcd), ("a.npz", npz)])
def test_damaged_clouds_are_told(tmp_path: Path, name: str, write: Callable[[Path], None]) -> None:
    file = tmp_path / name
    write(file)
    whole = file.read_bytes()
    for length in range(0, len(whole) - 40, 7):
        file.write_bytes(whole[:length])
        with pytest.raises(BadInputError, match=file.name):
            read_cloud(file)


def test_what_is_no_cloud_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"ends in '.obj'; expected a point cloud"):
        read_cloud(tmp_path / "mug.obj")
    np.save(tmp_path / "flat.npy", np.zeros((4, 2)))
    with pytest.raises(BadInputError, match=r"shape \(4, 2\) and type float64; expected \(N, 3\)"):
        read_cloud(tmp_path / "flat.npy")
    np.savez(tmp_path / "other.npz", xyz=POINTS)
    with pytest.raises(BadInputError, match="holds xyz; expected a point cloud"):
        read_cloud(tmp_path / "other.npz")
