"""Rests: what comes of drops, and the store that ships."""

import numpy as np
import pytest
import trimesh

from split_drake.data.rests import RestsError, load_rests, settle
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.rigid import Primitive, RigidObject
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
