"""What rounds of clutter removal come to."""

import json
import math
from dataclasses import asdict

import pytest

from scenarios.clutter.records import (
    EMPTIED,
    TWO_FAILURES,
    GraspRecord,
    Removal,
    RoundRecord,
    Share,
    kind_of_failure,
)

ROWS = [[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]]
NOTHING = "the hand holds nothing"


def grasp(reason: str = "", *taken: str) -> GraspRecord:
    return GraspRecord(ROWS, 0.7, 12, taken, (), (), reason)


def of_round(seed: int, index: int, *reasons: str, objects: int = 2) -> RoundRecord:
    names = tuple(f"box#{number}" for number in range(objects))
    grasps = tuple(grasp(reason) for reason in reasons)
    return RoundRecord(seed, index, names, grasps, TWO_FAILURES if reasons[-1] else EMPTIED)


def test_rates_are_pooled_over_rounds() -> None:
    records = [of_round(0, 0, "", ""), of_round(1, 0, "", NOTHING, NOTHING, objects=4)]
    removal = Removal.of(records)
    assert (removal.rounds, removal.attempts, removal.successes, removal.objects) == (2, 5, 3, 6)
    assert (removal.gsr.value, removal.dr.value) == (3 / 5, 3 / 6)
    assert removal.gsr.seeds == (1.0, 1 / 3)
    assert removal.gsr.interval == pytest.approx((1 / 3, 1.0))
    assert removal.ended == {EMPTIED: 1, TWO_FAILURES: 1}
    assert removal.failures == {NOTHING: 2}
    assert "66.7% ± 47.1% over seeds" in str(removal.gsr)


def test_intervals_are_wider_where_grasps_of_a_round_fail_together() -> None:
    together = [(0, 4), (0, 0)] * 20
    apart = [(0, 2)] * 40
    wide, narrow = (Share.of(parts, [4] * 40) for parts in (together, apart))
    assert wide.value == narrow.value == 0.5
    assert narrow.interval == (0.5, 0.5)
    assert wide.interval[1] - wide.interval[0] > 0.25


def test_no_attempt_has_no_rate() -> None:
    share = Share.of([(0, 0)], [0])
    assert math.isnan(share.value)
    assert str(share) == "none"
    none = Removal.of([RoundRecord(0, 0, (), (), "an error")]).to_json()
    assert none["gsr"] is None and none["dr_of_seeds"] == [None]
    json.dumps(none, allow_nan=False)
    assert share.interval == (0.0, 1.0)
    with pytest.raises(ValueError, match="no rounds were given"):
        Removal.of([])


def test_records_survive_their_line() -> None:
    record = of_round(3, 1, "", NOTHING)
    assert RoundRecord.from_fields(json.loads(json.dumps(asdict(record)))) == record


@pytest.mark.parametrize(
    ("reason", "kind"),
    [
        ("the hand touches a#1, table 50 mm before the grasp", "the hand touches something"),
        ("the pads closed to 3.1 mm", "the pads closed on nothing"),
        (
            "the hand is empty after close: its opening is 0.0 mm",
            "the hand is empty after close",
        ),
        (
            "the object slipped during transfer: the opening went from 16.3 mm to 12.6 mm",
            "the object slipped during transfer",
        ),
        (
            "the hand holds nothing; it was stopped 12 mm before the grasp by can#2",
            "the hand holds nothing; it was stopped on its way in",
        ),
    ],
)
def test_failures_are_counted_without_their_numbers(reason: str, kind: str) -> None:
    assert kind_of_failure(reason).startswith(kind)
    assert not any(character.isdigit() for character in kind_of_failure(reason))
