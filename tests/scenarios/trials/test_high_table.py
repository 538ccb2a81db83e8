"""Whole trials on a table that is higher than the robot's base."""

from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.trial import run_trial
from split_drake.station.config import StationConfig
from tests.helpers.stations import raised_layout


@pytest.mark.parametrize("task", ["hang", "reorient"])
def test_a_trial_on_a_table_10_cm_higher(task: str, tmp_path: Path) -> None:
    options = MugHangOptions(
        trials=1, detector="oracle", task=task, record="none", check_plans=True
    )
    (spec,) = specs_of(options, tmp_path, ())
    record = run_trial(replace(spec, station=StationConfig(raised_layout(0.10))))
    assert record.traceback is None, record.traceback
    assert record.violations == ()
    assert record.succeeded, record.reason
