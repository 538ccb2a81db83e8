"""The figures of the speed command, from records whose times are known."""

import pytest

from scenarios.records import TrialRecord
from scenarios.speed import GIB, figures


def record(planning_s: float, memory_gib: float) -> TrialRecord:
    return TrialRecord(
        index=0,
        seed=0,
        mug="test_000",
        mug_diameter_m=0.07,
        outcome="success",
        seconds={"planning": planning_s, "execution": 1.5, "verdict": 0.5},
        simulated_s=8.0,
        memory_bytes=round(memory_gib * GIB),
    )


def test_figures_are_those_of_the_records() -> None:
    alone = [record(planning_s, 0.4) for planning_s in (0.5, 0.9, 2.5)]
    both = [record(0.9, 0.5), record(0.9, 1.75)]
    found = {figure.name.split(",")[0]: figure for figure in figures(alone, 30.0, both, 15.0)}
    assert {name: figure.value for name, figure in found.items()} == {
        "planning": 0.9,
        "simulated s a second": 4.0,
        "minutes for 40 trials": 5.0,
        "GiB a worker": 1.75,
        "two workers": 2.0,
    }
    assert [name for name, figure in found.items() if not figure.met] == ["GiB a worker"]


def test_trials_that_never_planned_are_no_measure() -> None:
    failed = TrialRecord(0, 0, "test_000", 0.07, "simulator error")
    with pytest.raises(ValueError, match="none of 1 trials came as far as planning"):
        figures([failed], 1.0, [failed], 1.0)
