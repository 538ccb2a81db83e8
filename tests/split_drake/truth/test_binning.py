"""What is in the bin, what is left, and what is lost."""

from dataclasses import replace

import numpy as np
import pytest

from split_drake.poses import make_pose
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout, OpenBin
from split_drake.station.station import Station
from split_drake.truth.binning import sort_out
from split_drake.truth.state import Truth
from tests.split_drake.station.solids import solids

BIN = OpenBin()
TALL, CAN, FLAT, TIN, CUBE = range(5)


def test_objects_are_sorted_by_where_they_come_to_rest() -> None:
    station = Station(StationConfig(replace(Layout(), bin=BIN)), solids(), bearing=True)
    x, y, _ = BIN.p_WRim
    station.park_object(TALL)
    station.place_object(CAN, make_pose(p=(x, y, 0.05)))
    station.place_object(FLAT, make_pose(p=(x + 0.1, y + 0.1, 0.05)))
    station.place_object(TIN, make_pose(p=(0.5, 0.0, 0.001)))
    station.place_object(CUBE, make_pose(p=(0.5, 0.3, 0.03)))
    removal = sort_out(station, Truth(station), {FLAT})
    assert removal.taken == (CAN,)
    assert removal.lost == (CUBE,)
    assert removal.left == (TIN,)
    assert removal.rests
    assert station.present == (CAN, FLAT, TIN)
    assert BIN.contains(Truth(station).p_WCom(FLAT)), "what fell in stays in"
    assert sort_out(station, Truth(station), {CAN, FLAT}).taken == ()


def test_without_a_bin_nothing_is_sorted() -> None:
    station = Station(StationConfig(Layout()), [])
    with pytest.raises(ValueError, match="has no bin"):
        sort_out(station, Truth(station), ())


def test_a_bin_contains_what_is_between_its_walls_below_its_rim() -> None:
    x, y, z = BIN.p_WRim
    half, depth = BIN.size_m[0] / 2.0, BIN.size_m[2]
    assert BIN.contains(np.array([x, y, z - 0.01]))
    for p_W in (
        (x, y, z + 0.01),
        (x, y, z - depth - 0.01),
        (x + half + 0.01, y, z - 0.05),
        (x, y - half - 0.01, z - 0.05),
    ):
        assert not BIN.contains(np.array(p_W))
    with pytest.raises(ValueError, match="expected positive lengths"):
        OpenBin(wall_m=0.0)
