"""How fast the clutter station is: ``pytest tests/benchmarks/test_clutter_station.py``.

Factors of real time, with five resting objects, on one core.
"""

import time
from collections.abc import Callable

import numpy as np
import pytest

from split_drake.poses import make_pose
from split_drake.station.hand.grasp_execution import execute_grasp
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.truth.clutter_starts import pile_start
from split_drake.truth.removal import wait_for_all_to_rest
from split_drake.truth.state import Truth
from tests.benchmarks.processor import processor
from tests.split_drake.station.solids import DOWN, clear, solids, stand

REPEATS = 5


@pytest.fixture(scope="module")
def shared() -> HandStation:
    return HandStation(solids(), Layout())


@pytest.fixture
def station(shared: HandStation) -> HandStation:
    """Return the station with five objects that stand apart and rest."""
    clear(shared)
    for index, (x, y) in enumerate(((-1, -1), (-1, 1), (0, 0), (1, -1), (1, 1))):
        stand(shared, index, 0.5 + 0.09 * x, 0.09 * y)
    assert wait_for_all_to_rest(shared, Truth(shared))
    return shared


def _report(
    station: HandStation, capsys: pytest.CaptureFixture[str], name: str, act: Callable[[], object]
) -> None:
    """Act some times; print how many times as fast as real time the fastest was."""
    factors = []
    for _ in range(REPEATS):
        began_s, clock_s = station.time_s, time.process_time()
        act()
        factors.append((station.time_s - began_s) / (time.process_time() - clock_s))
    with capsys.disabled():
        print(
            f"\n{name}: {max(factors):.1f} times real time (median {np.median(factors):.1f}), "
            f"{len(station.present)} objects, {processor()}"
        )


def test_moving_hand(station: HandStation, capsys: pytest.CaptureFixture[str]) -> None:
    station.place_hand(make_pose(DOWN, (0.45, 0.0, 0.25)))

    def act() -> None:
        station.move((0.55, 0.0, 0.25))
        station.move((0.45, 0.0, 0.25), stop_at_contact=True)

    _report(station, capsys, "moving the hand", act)


def test_grasping(station: HandStation, capsys: pytest.CaptureFixture[str]) -> None:
    def act() -> None:
        stand(station, 2)
        assert execute_grasp(station, make_pose(DOWN, (0.5, 0.0, 0.04))).success

    _report(station, capsys, "a grasp", act)


def test_piling(station: HandStation, capsys: pytest.CaptureFixture[str]) -> None:
    truth, rng = Truth(station), np.random.default_rng(0)
    _report(station, capsys, "a pile", lambda: pile_start(station, truth, rng))
