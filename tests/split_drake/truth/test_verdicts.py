"""Truth, starts and success checks on a mug that hangs, falls, stands and lies."""

import re
from pathlib import Path

import numpy as np
import pytest

from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import Array, invert_pose, make_pose, rotation_x, rotation_y
from split_drake.station.config import StationConfig
from split_drake.station.fixtures import TABLE_BODY
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from split_drake.truth.rest import axis_tilt_rad
from split_drake.truth.starts import (
    NEARLY_UPRIGHT,
    UPSIDE_DOWN,
    draw_start,
    outside_workspace,
    reject_for_hang,
    reject_for_reorient,
)
from split_drake.truth.state import Truth
from split_drake.truth.verdicts import hang_verdict, peg_in_opening, reorient_verdict
from tests.helpers.stations import STATION, raised_layout


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("train_001")


@pytest.fixture
def station(mug: MugShape) -> Station:
    return Station(STATION, [mug.body])


def hanging_pose(mug: MugShape, layout: Layout, turn_rad: float = 0.0) -> Array:
    """Return X_WO with the peg through the middle of the handle's opening."""
    X_KHgoal = make_pose(rotation_y(-np.pi / 2.0 + turn_rad))
    return layout.X_WK @ X_KHgoal @ invert_pose(mug.X_OH)


@pytest.mark.parametrize("turn_rad", [-0.8, 0.0, 0.5])
def test_mug_released_around_the_peg_hangs(
    mug: MugShape, station: Station, turn_rad: float
) -> None:
    station.place_object(0, hanging_pose(mug, station.config.layout, turn_rad))
    verdict = hang_verdict(station, Truth(station), mug, release_time_s=0.0)
    assert verdict.success, verdict.reason
    assert station.time_s == pytest.approx(4.0)


def test_mug_beside_the_peg_falls(mug: MugShape, station: Station) -> None:
    X_WO = hanging_pose(mug, station.config.layout)
    X_WO[0, 3] += 0.06
    station.place_object(0, X_WO)
    verdict = hang_verdict(station, Truth(station), mug, release_time_s=0.0)
    assert not verdict.success
    assert "below the peg" in verdict.reason


def test_mug_held_around_the_peg_does_not_hang(mug: MugShape, station: Station) -> None:
    station.place_object(0, hanging_pose(mug, station.config.layout))
    truth = _TouchingHand(station)
    verdict = hang_verdict(station, truth, mug, release_time_s=0.0)
    assert verdict.reason == "the mug touches panda_hand"


class _TouchingHand(Truth):
    """Reports that the hand touches the mug as well."""

    def touching(self, index: int = 0) -> frozenset[str]:
        return super().touching(index) | {"panda_hand"}


def test_a_late_verdict_watches_the_second_from_then_on(mug: MugShape, station: Station) -> None:
    station.place_object(0, hanging_pose(mug, station.config.layout))
    station.advance(3.5)
    assert hang_verdict(station, Truth(station), mug, release_time_s=0.0).success
    assert station.time_s == pytest.approx(4.5)


def test_peg_is_in_the_opening_only_around_the_middle(mug: MugShape) -> None:
    layout = Layout()
    X_WO = hanging_pose(mug, layout)
    assert peg_in_opening(X_WO, mug, layout)
    along_peg = make_pose(p=0.2 * layout.X_WK[:3, 1])
    assert not peg_in_opening(along_peg @ X_WO, mug, layout), "beyond the tip"
    beside = make_pose(p=0.05 * layout.X_WK[:3, 0])
    assert not peg_in_opening(beside @ X_WO, mug, layout)
    inside_body = X_WO @ make_pose(p=(mug.X_OH[0, 3], 0.0, 0.0))
    assert not peg_in_opening(inside_body, mug, layout), "through the body"


def test_standing_mug_rests_with_little_penetration(mug: MugShape, station: Station) -> None:
    truth = Truth(station)
    station.place_object(0, make_pose(p=(0.5, 0.0, 0.001)))
    verdict = reorient_verdict(station, truth)
    assert verdict.success, verdict.reason
    assert 0.0 < truth.penetration_m({TABLE_BODY}) < 5e-4
    assert axis_tilt_rad(truth.X_WO()) < 0.01
    assert truth.p_WCom()[2] == pytest.approx(mug.body.p_OCom[2], abs=1e-3)


def test_lying_mug_is_not_upright(mug: MugShape, station: Station) -> None:
    station.place_object(0, make_pose(rotation_x(np.pi / 2.0), (0.5, 0.0, 0.06)))
    verdict = reorient_verdict(station, Truth(station), timeout_s=6.0)
    assert not verdict.success
    assert "off upright" in verdict.reason


def test_falling_mug_is_not_at_rest(mug: MugShape, station: Station) -> None:
    station.place_object(0, make_pose(p=(0.5, 0.0, 0.5)))
    assert reorient_verdict(station, Truth(station), timeout_s=0.1).reason.startswith("still")


def test_starts_lie_in_the_workspace_as_the_scenario_wants(mug: MugShape, station: Station) -> None:
    truth, rng = Truth(station), np.random.default_rng(3)
    for _ in range(3):
        start = draw_start(station, truth, rng, reject_for_reorient)
        np.testing.assert_array_equal(start.X_WO, truth.X_WO())
        assert np.radians(30.0) <= axis_tilt_rad(start.X_WO) <= np.radians(120.0)
        assert not outside_workspace(mug.body, start.X_WO, station.config.layout.workspace)
        assert truth.touching() == {"table"}


def test_same_seed_draws_the_same_start(mug: MugShape) -> None:
    starts = []
    for _ in range(2):
        station = Station(STATION, [mug.body])
        rng = np.random.default_rng(7)
        starts.append(draw_start(station, Truth(station), rng, reject_for_hang))
    np.testing.assert_array_equal(starts[0].X_WO, starts[1].X_WO)
    assert starts[0].redraws == starts[1].redraws


def test_starts_that_are_never_accepted_end_with_an_error(station: Station) -> None:
    with pytest.raises(RuntimeError, match="2 starts of train_001 were all rejected"):
        draw_start(
            station, Truth(station), np.random.default_rng(0), lambda X_WO: "no", max_draws=2
        )


def test_rejections_name_the_reason() -> None:
    assert reject_for_hang(np.eye(4)) == ""
    assert reject_for_reorient(np.eye(4)) == NEARLY_UPRIGHT
    assert reject_for_hang(make_pose(rotation_x(np.pi))) == UPSIDE_DOWN
    assert reject_for_reorient(make_pose(rotation_x(np.pi / 2.0))) == ""


def test_only_the_truths_room_reads_the_simulators_truth() -> None:
    package = Path(__file__).parents[3]
    readers = {
        path.parent.relative_to(package).as_posix()
        for folder in ("split_drake", "planning", "scenarios")
        for path in (package / folder).rglob("*.py")
        if re.search(r"\bplant_context\b", path.read_text())
    }
    assert readers == {"split_drake/truth", "split_drake/station", "split_drake/station/hand"}


def test_a_mug_stands_on_a_table_at_another_height(mug: MugShape) -> None:
    station = Station(StationConfig(raised_layout(0.10)), [mug.body])
    truth = Truth(station)
    station.place_object(0, make_pose(p=(0.5, 0.0, 0.101)))
    verdict = reorient_verdict(station, truth)
    assert verdict.success, verdict.reason
    assert truth.X_WO()[2, 3] == pytest.approx(0.10, abs=1e-3)
    station.place_object(0, make_pose(rotation_x(np.pi / 2.0), (0.5, 0.0, 0.16)))
    assert not reorient_verdict(station, truth, timeout_s=6.0).success


def test_a_mug_hangs_above_a_table_at_another_height(mug: MugShape) -> None:
    station = Station(StationConfig(raised_layout(0.10)), [mug.body])
    station.place_object(0, hanging_pose(mug, station.config.layout))
    assert hang_verdict(station, Truth(station), mug, release_time_s=0.0).success
