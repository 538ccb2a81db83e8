"""Limits of the robot: what is logged, and what is said to be exceeded."""

from dataclasses import replace

import numpy as np
import pytest

from scenarios.trials.limit_log import LimitLog, Peaks, worst
from scenarios.trials.records import TrialRecord, worst_peaks
from scenarios.trials.report.page import row_of
from scenarios.trials.report.summary import rates_by_width
from split_drake.objects.mugs.split import load_mug
from split_drake.robot.panda import MAX_WEIGHT_NM, arm_limits, weight_torques_nm
from split_drake.robot.posture import Q_HOME
from split_drake.station.station import Station
from split_drake.truth.state import Truth
from tests.helpers.planning import configuration
from tests.helpers.stations import STATION

WITHIN = Peaks(0.5, 0.7, 0.6, 0.001)


def watched() -> Station:
    return Station(STATION, [load_mug("test_004").body], logged=True)


def test_an_arm_at_rest_feels_its_weight_alone() -> None:
    station = watched()
    log = LimitLog(station, Truth(station))
    station.advance(0.05)
    limits = arm_limits()
    margins = np.minimum(Q_HOME - limits.q_lower, limits.q_upper - Q_HOME)
    weight = np.abs(weight_torques_nm(Q_HOME)) / limits.effort_max_nm
    assert log.peaks.position_margin_rad == pytest.approx(margins.min(), abs=1e-4)
    assert log.peaks.torque_share == pytest.approx(weight.max(), abs=0.01)
    assert log.peaks.velocity_share < 0.01
    assert log.peaks.pad_depth_m == 0.0


def test_a_commanded_jump_is_seen_as_too_fast() -> None:
    station = watched()
    log = LimitLog(station, Truth(station))
    station.command(Q_HOME + 0.5, np.zeros(7), 0.08, 40.0)
    station.advance(0.3)
    assert log.peaks.velocity_share > 1.0
    assert 0.3 < log.peaks.torque_share <= 1.0
    assert any(text.startswith("velocity") for text in log.peaks.exceeded())


def test_a_single_fast_step_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    station = watched()
    log = LimitLog(station, Truth(station))
    station.advance(0.03)
    states, torques_nm = station.take_log()
    assert len(states) == len(torques_nm) >= 15
    states[8, 9:16] = 2.0 * arm_limits().v_max
    monkeypatch.setattr(station, "take_log", lambda: (states, torques_nm))
    assert log.peaks.velocity_share == pytest.approx(2.0)


def test_what_came_before_the_log_is_no_peak() -> None:
    station = watched()
    station.command(Q_HOME + 0.5, np.zeros(7), 0.08, 40.0)
    station.advance(0.3)
    station.command(station.q, np.zeros(7), 0.08, 40.0)
    station.advance(0.5)
    log = LimitLog(station, Truth(station))
    station.advance(0.05)
    assert log.peaks.velocity_share < 0.1


def test_the_weight_is_that_of_each_step(monkeypatch: pytest.MonkeyPatch) -> None:
    station = watched()
    log = LimitLog(station, Truth(station))
    stretched = np.array([0.0, 1.0, 0.0, -0.5, 0.0, 1.5, 0.0])
    for qs in (np.stack([stretched, Q_HOME]), np.stack([Q_HOME, stretched])):
        states = np.hstack([qs, np.zeros((2, 11))])
        monkeypatch.setattr(station, "take_log", lambda states=states: (states, np.zeros((2, 7))))
        share = np.abs(weight_torques_nm(stretched)) / arm_limits().effort_max_nm
        assert log.peaks.torque_share == pytest.approx(share.max())


def test_joints_are_read_in_every_step_and_once() -> None:
    station = watched()
    station.take_log()
    station.advance(0.02)
    states, torques_nm = station.take_log()
    assert states.shape == (10, 18) and torques_nm.shape == (10, 7)
    np.testing.assert_array_equal(states[-1], station.panda_state)
    np.testing.assert_array_equal(torques_nm[-1], station.joint_torques_nm)
    assert len(station.take_log()[0]) == 0
    with pytest.raises(RuntimeError, match="logged=True"):
        Station(STATION).take_log()


def test_a_hand_in_the_table_is_seen() -> None:
    station = watched()
    log = LimitLog(station, Truth(station))
    station.advance(0.02)
    assert log.peaks.fixture_depth_m == 0.0
    q_in_table = configuration((0.5, 0.3, 0.0))
    station.set_arm(q_in_table, 0.08)
    station.command(q_in_table, np.zeros(7), 0.08, 40.0)
    station.advance(0.02)
    assert 0.001 < log.peaks.fixture_depth_m < 0.015
    assert any(text.endswith("in fixtures") for text in log.peaks.exceeded())


def test_no_weight_is_greater_than_what_is_left_for_it() -> None:
    limits, rng = arm_limits(), np.random.default_rng(1)
    qs = rng.uniform(limits.q_lower, limits.q_upper, (500, 7))
    largest = np.max([np.abs(weight_torques_nm(q)) for q in qs], axis=0)
    assert np.all(largest <= MAX_WEIGHT_NM)
    assert np.all(largest[1:] >= 0.7 * np.array(MAX_WEIGHT_NM[1:])), "no more than it takes"


def test_weight_torques_lift_the_arm() -> None:
    stretched = np.array([0.0, np.pi / 2.0, 0.0, -0.1, 0.0, 1.6, 0.0])
    # Joint 2 carries all of an arm stretched forwards; joint 1, about the vertical, nothing.
    assert weight_torques_nm(stretched)[1] < -20.0
    assert abs(weight_torques_nm(stretched)[0]) < 1e-9


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"position_margin_rad": -0.01}, "range by 0.010 rad"),
        ({"velocity_share": 1.2}, "velocity 120%"),
        ({"torque_share": 1.01}, "torque 101%"),
        ({"pad_depth_m": 0.0025}, "pads 2.5 mm deep"),
        ({"fixture_depth_m": 0.0004}, "robot 0.4 mm in fixtures"),
    ],
)
def test_what_is_exceeded_is_named(change: dict[str, float], text: str) -> None:
    assert WITHIN.exceeded() == ()
    assert replace(WITHIN, **change).exceeded() == (text,)


def test_reports_show_what_is_exceeded() -> None:
    fast = replace(WITHIN, velocity_share=1.3, position_margin_rad=0.4)
    record = TrialRecord(0, 0, "cup", 0.08, "success", peaks=fast.rounded())
    slow = replace(record, index=1, peaks=WITHIN.rounded())
    failed = replace(record, index=2, outcome="error", peaks={})
    assert failed.exceeded == ()
    for each, expected in ((record, 1), (slow, 0), (failed, 0)):
        texts = [str(cell.value) for cell in row_of(each).cells]
        assert sum("velocity 130%" in text for text in texts) == expected
    assert rates_by_width([record])["all mugs"].successes == 1
    assert worst_peaks([slow, record, failed]) == fast.rounded()
    assert worst_peaks([failed]) == {}
    assert worst([]) is None
