"""Rests: what comes of drops, and the store that ships."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.data import rests
from split_drake.data.rests import (
    Rests,
    RestsError,
    SettleConfig,
    load_rests,
    rests_in,
    settle,
    settle_split,
)
from split_drake.experiments.pool import InThisProcess
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.station.layout import Layout
from split_drake.truth.rest import axis_tilt_rad
from split_drake.truth.starts import UPSIDE_DOWN_RAD
from tests.helpers.stations import STATION


def test_dropped_box_lies_on_one_of_its_faces() -> None:
    size = (0.06, 0.06, 0.06)
    mesh = trimesh.creation.box(size)
    inertia = mesh.moment_inertia * 0.2 / mesh.volume
    pieces = (Primitive("box", size, np.eye(4)),)
    box = RigidObject("box", mesh, 0.2, np.zeros(3), inertia, pieces)
    rests = settle(box, 3, np.random.default_rng(0), STATION)
    assert rests.dropped >= len(rests.X_TOs) == 3
    np.testing.assert_allclose(rests.X_TOs[:, 2, 3], 0.03, atol=1e-3)
    flat = np.abs(rests.X_TOs[:, 2, :3]).max(axis=1)
    np.testing.assert_allclose(flat, 1.0, atol=1e-3)


def test_shipped_rests_touch_the_table_and_are_not_upside_down() -> None:
    mug, rests = load_mug("test_005"), load_rests("test", "test_005")
    for X_TO in rests.X_TOs:
        lowest_m = (mug.body.mesh.vertices @ X_TO[2, :3]).min() + X_TO[2, 3]
        assert abs(lowest_m) < 0.002
        assert axis_tilt_rad(X_TO) <= UPSIDE_DOWN_RAD
    assert rests.dropped >= len(rests.X_TOs)


@pytest.mark.parametrize("name", ["train_999", "test_005"])
def test_mugs_that_are_not_of_the_split_are_refused(name: str) -> None:
    with pytest.raises(RestsError, match=f"{name}.*expected one of train's mugs"):
        load_rests("train", name)


def test_rests_of_mugs_that_were_dropped_are_not_dropped_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, dropped = tmp_path / "rests_test.npz", list[str]()
    monkeypatch.setattr(rests, "rests_path", lambda mugs: file)
    monkeypatch.setattr(MugSource, "names", lambda source: ("test_001", "test_002", "test_003"))
    monkeypatch.setattr(rests, "make_pool", lambda scheduler, workers, work: InThisProcess(work))

    def settle(body: RigidObject, count: int, *_: object) -> Rests:
        dropped.append(body.name)
        if len(dropped) == 2:
            raise KeyboardInterrupt
        return Rests(np.tile(np.eye(4), (count, 1, 1)), count)

    monkeypatch.setattr(rests, "settle", settle)
    config = SettleConfig("test", count=2, workers=1)
    with pytest.raises(SystemExit, match="the same command goes on"):
        settle_split(config, Layout())
    settle_split(config, Layout())
    assert dropped == ["test_001", "test_002", "test_002", "test_003"]
    assert rests_in(file, MugSource("test"), "test_003").dropped == 2
    assert list(tmp_path.iterdir()) == [file]
