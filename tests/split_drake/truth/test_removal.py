"""What is taken, what is lost, and when the rest has come to rest."""

import numpy as np
import pytest

from split_drake.poses import make_pose, rotation_x
from split_drake.scene import Workspace
from split_drake.station.hand.grasp_execution import execute_grasp
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.truth.removal import (
    clear_away,
    in_cube,
    outside,
    wait_for_all_to_rest,
)
from split_drake.truth.state import Truth
from tests.split_drake.station.solids import DOWN, clear, solids, stand

TALL, CAN, FLAT, TIN, CUBE = range(5)


@pytest.fixture(scope="module")
def shared() -> HandStation:
    return HandStation(solids(), Layout())


@pytest.fixture
def station(shared: HandStation) -> HandStation:
    clear(shared)
    return shared


def test_taken_object_is_removed_with_the_hand(station: HandStation) -> None:
    stand(station, CUBE)
    stand(station, TIN, y=0.12)
    execution = execute_grasp(station, make_pose(DOWN, (0.5, 0.0, 0.03)))
    assert execution.held == ("cube",)
    removal = clear_away(station, Truth(station), execution.held)
    assert removal.taken == (CUBE,)
    assert removal.lost == ()
    assert removal.left == station.present == (TIN,)
    assert removal.rests
    assert not station.touching()


def test_what_leaves_the_cube_is_lost(station: HandStation) -> None:
    stand(station, CUBE)
    stand(station, FLAT, y=0.16)
    # Falls off the table.
    stand(station, TIN, x=0.5, y=0.61)
    truth = Truth(station)
    assert outside(station, truth) == [FLAT, TIN]
    removal = clear_away(station, truth)
    assert removal.taken == ()
    assert removal.lost == (FLAT, TIN)
    assert removal.left == (CUBE,)


def test_waiting_ends_at_rest_and_not_before(station: HandStation) -> None:
    truth = Truth(station)
    station.place_object(CUBE, make_pose(rotation_x(0.5), (0.5, 0.0, 0.15)))
    began_s = station.time_s
    assert wait_for_all_to_rest(station, truth)
    assert 0.2 < station.time_s - began_s < 1.5
    v, w = truth.velocity(CUBE)
    assert max(np.abs(v).max(), np.abs(w).max()) < 0.01
    station.place_object(CUBE, make_pose(p=(0.5, 0.0, 0.5)))
    assert not wait_for_all_to_rest(station, truth, timeout_s=0.2)


def test_nothing_on_the_table_rests_at_once(station: HandStation) -> None:
    began_s = station.time_s
    assert wait_for_all_to_rest(station, Truth(station))
    assert station.time_s - began_s < 0.15


def test_cube_reaches_below_the_table_as_the_grid_does() -> None:
    workspace = Workspace()
    for p_WP, inside in (
        ((0.5, 0.0, 0.001), True),
        ((0.36, -0.14, 0.24), True),
        ((0.34, 0.0, 0.1), False),
        ((0.5, 0.0, 0.26), False),
        ((0.5, 0.0, -0.06), False),
    ):
        assert in_cube(np.array(p_WP), workspace) == inside
