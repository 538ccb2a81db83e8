"""What the robot notices to have gone wrong, from segments and openings made up for the purpose."""

import numpy as np
import pytest

from planning.execution.faults import (
    BLOCKING_FORCE_N,
    CATCHING_FORCE_N,
    CONTACT_FORCE_N,
    EMPTY_OPENING_M,
    LOSS_STAGES,
    SLIP_M,
    Fault,
    find_fault,
    force_limit_n,
)
from planning.motion.timing import rest
from planning.problem import Segment, SegmentName, Stage

WIDTH_M = 0.005


def segment(name: SegmentName, feel: bool = False) -> Segment:
    return Segment(name, rest(np.zeros(7), 0.1), -0.05, -0.05, 40.0, True, stop_on_contact=feel)


@pytest.mark.parametrize(("name", "stage"), LOSS_STAGES.items())
def test_a_closed_hand_holds_nothing(name: SegmentName, stage: Stage) -> None:
    found = find_fault(segment(name), False, WIDTH_M, 0.5 * EMPTY_OPENING_M)
    assert found is not None
    assert (found.fault, found.stage) == (Fault.EMPTY, stage)
    assert name.value in found.reason and "0.5 mm" in found.reason


@pytest.mark.parametrize("name", [SegmentName.TRANSIT, SegmentName.OPEN, SegmentName.RETREAT])
def test_a_hand_that_need_not_hold_may_be_closed(name: SegmentName) -> None:
    assert find_fault(segment(name), False, WIDTH_M, 0.0) is None


@pytest.mark.parametrize("name", [SegmentName.TRANSFER, SegmentName.INSERT])
@pytest.mark.parametrize("change", [-1.1, 1.1])
def test_a_width_that_changes_on_the_way_is_a_slip(name: SegmentName, change: float) -> None:
    before_m = 0.030
    found = find_fault(segment(name), False, before_m, before_m + change * SLIP_M)
    assert found is not None
    assert (found.fault, found.stage) == (Fault.SLIPPED, LOSS_STAGES[name])
    assert "30.0 mm to" in found.reason


@pytest.mark.parametrize("name", [SegmentName.TRANSFER, SegmentName.INSERT])
def test_a_width_that_wavers_is_none(name: SegmentName) -> None:
    assert find_fault(segment(name), False, WIDTH_M, WIDTH_M - 0.9 * SLIP_M) is None


@pytest.mark.parametrize("name", [SegmentName.CLOSE, SegmentName.LIFT, SegmentName.BACK_OUT])
def test_a_width_counts_only_where_the_object_is_carried_to_its_place(name: SegmentName) -> None:
    assert find_fault(segment(name), False, 0.060, 0.005) is None


def test_an_insertion_that_is_stopped_was_blocked() -> None:
    found = find_fault(segment(SegmentName.INSERT), True, WIDTH_M, WIDTH_M)
    assert found is not None
    assert (found.fault, found.stage) == (Fault.BLOCKED, Stage.PLACEMENT)
    assert f"{BLOCKING_FORCE_N:g} N" in found.reason


@pytest.mark.parametrize("stopped", [False, True])
def test_lowering_by_feel_is_to_be_stopped_while_the_object_stays_in_the_hand(
    stopped: bool,
) -> None:
    feeling = segment(SegmentName.INSERT, feel=True)
    assert force_limit_n(feeling) == CONTACT_FORCE_N
    assert find_fault(feeling, stopped, WIDTH_M, WIDTH_M - 0.9 * SLIP_M) is None
    found = find_fault(feeling, stopped, 0.030, 0.030 - 1.1 * SLIP_M)
    assert found is not None and found.fault is Fault.SLIPPED


def test_an_open_hand_that_is_stopped_on_its_way_back_is_caught() -> None:
    found = find_fault(segment(SegmentName.RETREAT), True, 0.08, 0.08)
    assert found is not None
    assert (found.fault, found.stage) == (Fault.CAUGHT, Stage.PLACEMENT)
    assert f"{CATCHING_FORCE_N:g} N" in found.reason


def test_insertions_and_an_open_hand_in_an_object_alone_are_stopped_by_force() -> None:
    limits = {name: force_limit_n(segment(name)) for name in SegmentName}
    assert limits.pop(SegmentName.INSERT) == BLOCKING_FORCE_N
    assert limits.pop(SegmentName.RETREAT) == CATCHING_FORCE_N
    assert limits.pop(SegmentName.EASE) == CATCHING_FORCE_N
    assert set(limits.values()) == {float("inf")}
