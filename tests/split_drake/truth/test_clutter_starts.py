"""Packed and pile starts of the clutter protocol."""

from collections.abc import Callable

import numpy as np
import pytest

from split_drake.objects.rigid import RigidObject
from split_drake.poses import rotation_error_rad
from split_drake.scene import Workspace
from split_drake.station.fixtures import TABLE_BODY
from split_drake.station.hand.fence import FENCE_BODY
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.truth.clutter_starts import ClutterStart, packed_start, pile_start
from split_drake.truth.removal import in_cube
from split_drake.truth.rest import axis_tilt_rad
from split_drake.truth.state import Truth
from tests.split_drake.station.solids import solid_box, solids


@pytest.fixture(scope="module")
def station() -> HandStation:
    return HandStation(solids(), Layout())


@pytest.mark.parametrize("seed", range(4))
def test_packed_objects_stand_apart_within_bounds(station: HandStation, seed: int) -> None:
    truth = Truth(station)
    start = packed_start(station, truth, np.random.default_rng(seed))
    assert start.rests
    assert 3 <= len(start.indices) <= 5
    assert start.indices == station.present
    for index, X_WO in zip(start.indices, start.X_WOs, strict=True):
        np.testing.assert_array_equal(X_WO, truth.X_WO(index))
        assert axis_tilt_rad(X_WO) < 0.005
        assert np.abs(X_WO[:2, 3] - (0.5, 0.0)).max() < 0.0705
        lowest = (X_WO[2, 3] + station.objects[index].mesh.bounds[0][2]) * 1e3
        assert abs(lowest) < 0.5, f"{lowest} mm above the table"
        assert truth.touching(index) == {TABLE_BODY}


@pytest.mark.parametrize("seed", range(3))
def test_piles_rest_inside_the_cube(station: HandStation, seed: int) -> None:
    truth = Truth(station)
    start = pile_start(station, truth, np.random.default_rng(seed))
    assert len(start.indices) >= 4
    workspace = station.config.layout.workspace
    for index in start.indices:
        assert in_cube(truth.p_WCom(index), workspace)
        assert FENCE_BODY not in truth.touching(index)
    station.advance(0.1)
    if start.rests:
        for index, X_WO in zip(start.indices, start.X_WOs, strict=True):
            assert np.linalg.norm(truth.X_WO(index)[:3, 3] - X_WO[:3, 3]) < 2e-3
            assert rotation_error_rad(truth.X_WO(index)[:3, :3], X_WO[:3, :3]) < 0.02


@pytest.mark.parametrize("draw", [packed_start, pile_start])
def test_same_seed_gives_the_same_start(draw: Callable[..., ClutterStart]) -> None:
    starts = []
    for _ in range(2):
        fresh = HandStation(solids()[:3], Layout())
        starts.append(draw(fresh, Truth(fresh), np.random.default_rng(5)))
    assert starts[0].indices == starts[1].indices
    np.testing.assert_array_equal(starts[0].X_WOs, starts[1].X_WOs)


def test_starts_lie_wherever_the_workspace_is() -> None:
    layout = Layout(workspace=Workspace(p_WCenter=(0.62, 0.2, 0.0)))
    station = HandStation(solids()[:2], layout)
    truth = Truth(station)
    for draw in (packed_start, pile_start):
        start = draw(station, truth, np.random.default_rng(0))
        assert len(start.indices) == 2
        for index in start.indices:
            assert np.abs(truth.p_WCom(index)[:2] - (0.62, 0.2)).max() < 0.15


def test_objects_that_find_no_room_stay_out() -> None:
    big = [solid_box(f"big_{number}", (0.25, 0.25, 0.05), 1.0) for number in range(3)]
    station = HandStation(big, Layout())
    start = packed_start(station, Truth(station), np.random.default_rng(0))
    assert start.indices == (0,)
    assert start.X_WOs.shape == (1, 4, 4)


def test_without_objects_there_is_an_empty_start() -> None:
    objects: list[RigidObject] = []
    station = HandStation(objects, Layout())
    for draw in (packed_start, pile_start):
        start = draw(station, Truth(station), np.random.default_rng(0))
        assert start.indices == ()
        assert start.X_WOs.shape == (0, 4, 4)
