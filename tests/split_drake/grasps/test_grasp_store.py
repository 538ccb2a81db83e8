"""Checked grasps: their mirror images, their file, and the store that ships."""

from pathlib import Path

import numpy as np
import pytest

from split_drake.files import UnreadableFileError, read_npz
from split_drake.grasps.free_hand import MAX_SLIP_M, FreeHand
from split_drake.grasps.judge import MIN_QUALITY, GraspJudge
from split_drake.grasps.store import (
    CheckedGrasps,
    GraspStoreError,
    load_checked_grasps,
    read_store,
    write_store,
)
from split_drake.objects.mugs.split import Split, load_mug
from split_drake.poses import make_pose, rotation_z
from tests.helpers.damage import times_told
from tests.helpers.stations import STATION


def grasps() -> CheckedGrasps:
    return CheckedGrasps(
        X_OGs=np.stack([make_pose(rotation_z(0.3), (0.1, 0.02, 0.05)), make_pose()]),
        openings_m=np.array([0.03, 0.05]),
        qualities=np.array([0.75, 1.0]),
        faults=np.array(["", "empty"]),
        slips_m=np.array([MAX_SLIP_M / 4.0, np.inf]),
        turns_rad=np.array([0.0, np.inf]),
    )


def test_robustness_falls_with_slip_and_is_zero_where_a_grasp_fails() -> None:
    np.testing.assert_allclose(grasps().robustness, [0.75, 0.0])


def test_mirror_image_is_a_grasp_on_the_other_side() -> None:
    both = grasps().with_mirror_images()
    assert len(both) == 4
    np.testing.assert_allclose(both.X_OGs[2, :3, 3], [0.1, -0.02, 0.05])
    np.testing.assert_allclose(np.linalg.det(both.X_OGs[:, :3, :3]), 1.0)
    np.testing.assert_allclose(both.X_OGs[2, :3, 0] * (1, -1, 1), both.X_OGs[0, :3, 0], atol=1e-12)


def test_mirror_image_fares_alike_geometrically() -> None:
    both = load_checked_grasps("train", "train_003").with_mirror_images()
    check = GraspJudge(load_mug("train_003").body.mesh).check_opened(both.X_OGs, both.openings_m)
    original, mirrored = np.split(check.qualities, 2)
    assert np.median(np.abs(original - mirrored)) < 0.03


def test_written_store_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "grasps.npz"
    write_store(path, {"a": grasps(), "b": grasps()}, "1234")
    read = read_store(path, "1234")
    assert list(read) == ["a", "b"]
    np.testing.assert_allclose(read["b"].X_OGs, grasps().X_OGs, atol=1e-6)
    assert read["b"].faults.tolist() == ["", "empty"]


def test_store_of_other_mugs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "grasps.npz"
    write_store(path, {"a": grasps()}, "1234")
    with pytest.raises(GraspStoreError, match="made for mugs of SHA-256 1234"):
        read_store(path, "5678")


def test_missing_store_says_what_makes_it(tmp_path: Path) -> None:
    with pytest.raises(GraspStoreError, match="check_grasps"):
        read_store(tmp_path / "none.npz", "1234")


@pytest.mark.parametrize(("split", "name"), [("train", "train_003"), ("test", "test_005")])
def test_shipped_grasps_are_well_formed(split: Split, name: str) -> None:
    checked = load_checked_grasps(split, name)
    assert len(checked) >= 60
    assert checked.holds.mean() > 0.5
    assert (checked.qualities > MIN_QUALITY - 1e-6).all()
    R_OGs = checked.X_OGs[:, :3, :3]
    np.testing.assert_allclose(
        R_OGs @ R_OGs.swapaxes(1, 2), np.tile(np.eye(3), (len(checked), 1, 1)), atol=1e-5
    )


def test_shipped_outcomes_are_those_of_the_free_hand() -> None:
    checked = load_checked_grasps("test", "test_005")
    hand = FreeHand(load_mug("test_005").body, STATION)
    for number in (0, 1, 2, 3):
        hold = hand.try_grasp(checked.X_OGs[number], checked.openings_m[number])
        assert hold.holds == checked.holds[number]
        if hold.holds:
            assert hold.slip_m == pytest.approx(checked.slips_m[number], abs=2e-3)


@pytest.mark.parametrize("name", ["train_999", "test_005"])
def test_mugs_that_are_not_of_the_split_are_refused(name: str) -> None:
    with pytest.raises(GraspStoreError, match=f"{name}.*expected one of train's mugs"):
        load_checked_grasps("train", name)


def test_a_damaged_store_is_told_with_its_path(tmp_path: Path) -> None:
    path = tmp_path / "grasps.npz"
    write_store(path, {"a": grasps(), "b": grasps()}, "1234")
    assert times_told(path, lambda given: read_store(given, "1234")) > 50
    arrays = read_npz(path, "store")
    np.savez(path, allow_pickle=False, **{**arrays, "counts": np.array([2, 3])})
    with pytest.raises(UnreadableFileError, match=rf"{path} is damaged .*its counts say 5 rows"):
        read_store(path, "1234")
    np.savez(path, mugs_sha256=np.array("1234"))
    with pytest.raises(UnreadableFileError, match=f"{path} holds mugs_sha256, but no 'counts'"):
        read_store(path, "1234")
