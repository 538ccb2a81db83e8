"""The protocol's grasp: what succeeds, and the reasons of what does not."""

import numpy as np
import pytest

from split_drake.poses import make_pose, rotation_y, rotation_z
from split_drake.station.hand.grasp_execution import execute_grasp, retreat_direction
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.truth.state import Truth
from tests.split_drake.station.solids import DOWN, clear, solid_box, solid_cylinder, stand

CAN, WIDE, THIN, CUBE, PEN = range(5)
X_WG = make_pose(DOWN, (0.5, 0.0, 0.03))


@pytest.fixture(scope="module")
def shared() -> HandStation:
    return HandStation(
        [
            solid_cylinder("can", 0.03, 0.12),
            solid_box("wide", (0.1, 0.1, 0.05)),
            solid_box("thin", (0.05, 0.005, 0.08), 0.1),
            solid_box("cube", (0.05, 0.05, 0.05), 0.15),
            solid_box("pen", (0.1, 0.012, 0.012), 0.012),
        ],
        Layout(),
    )


@pytest.fixture
def station(shared: HandStation) -> HandStation:
    clear(shared)
    return shared


def test_grasp_from_above_lifts_the_object(station: HandStation) -> None:
    stand(station, CUBE)
    execution = execute_grasp(station, X_WG)
    assert execution.success, execution.reason
    assert execution.stage == "retreat"
    assert execution.held == ("cube",)
    assert execution.stopped_by == ()
    assert execution.opening_m == pytest.approx(0.05, abs=1e-3)
    assert Truth(station).X_WO(CUBE)[2, 3] == pytest.approx(0.125, abs=3e-3)


def test_pads_hardly_sink_into_what_is_light(station: HandStation) -> None:
    stand(station, PEN)
    execution = execute_grasp(station, make_pose(DOWN, (0.5, 0.0, 0.014)))
    assert execution.success, execution.reason
    assert execution.opening_m == pytest.approx(0.012, abs=1e-3)


def test_grasp_from_the_side_lifts_the_object_straight_up(station: HandStation) -> None:
    stand(station, CAN)
    sideways = rotation_z(0.3) @ rotation_y(np.pi / 2.0)
    execution = execute_grasp(station, make_pose(sideways, (0.5, 0.0, 0.07)))
    assert execution.success, execution.reason
    np.testing.assert_allclose(station.X_WG[:3, 3], (0.5, 0.0, 0.17), atol=2e-3)
    assert Truth(station).X_WO(CAN)[2, 3] > 0.09


def test_object_wider_than_the_hand_is_told(station: HandStation) -> None:
    stand(station, WIDE)
    execution = execute_grasp(station, X_WG)
    assert not execution.success
    assert execution.stopped_by == ("wide",)
    assert execution.short_m == pytest.approx(0.05 + 0.011 - 0.03, abs=1.5e-3)
    expected = "the hand holds nothing; it was stopped 31 mm before the grasp by wide"
    assert execution.reason == expected


def test_contact_at_the_pregrasp_fails(station: HandStation) -> None:
    stand(station, CAN, y=0.05)
    execution = execute_grasp(station, X_WG)
    assert (execution.stage, execution.stopped_by) == ("pregrasp", ("can",))
    assert execution.reason == "the hand touches can 50 mm before the grasp"
    assert execution.opening_m == pytest.approx(0.08)


def test_contact_on_the_way_in_fails_where_it_is_not_allowed(station: HandStation) -> None:
    stand(station, CUBE, y=0.02)
    execution = execute_grasp(station, X_WG, touching_allowed=False)
    assert (execution.stage, execution.stopped_by) == ("approach", ("cube",))
    assert execution.reason == "the hand touches cube 31 mm before the grasp"


def test_approach_into_the_table_stops_there(station: HandStation) -> None:
    execution = execute_grasp(station, make_pose(DOWN, (0.5, 0.0, -0.02)))
    assert execution.stopped_by == ("table",)
    assert execution.reason.startswith("the hand holds nothing; it was stopped")


def test_pads_that_close_too_far_hold_nothing(station: HandStation) -> None:
    stand(station, THIN)
    execution = execute_grasp(station, make_pose(DOWN, (0.5, 0.0, 0.05)))
    assert execution.held == ("thin",)
    assert execution.reason == f"the pads closed to {1e3 * execution.opening_m:.1f} mm"
    assert execution.opening_m < 0.006


def test_retreat_is_back_from_above_and_up_from_the_side() -> None:
    for angle_deg, up in ((0.0, False), (59.0, False), (61.0, True), (90.0, True)):
        approach = rotation_y(np.radians(angle_deg)) @ (0.0, 0.0, -1.0)
        expected = (0.0, 0.0, 1.0) if up else -approach
        np.testing.assert_allclose(retreat_direction(approach), expected, atol=1e-12)
