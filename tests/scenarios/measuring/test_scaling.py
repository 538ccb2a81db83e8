"""What more workers bring."""

from pathlib import Path

import pytest

from scenarios.measuring.scaling import (
    NETWORK_BYTES_PER_S,
    Measured,
    ScalingOptions,
    computed_trials_per_hour,
    measure,
    to_table,
)
from split_drake.bad_input import BadInputError


def test_more_workers_do_more_until_something_else_is_the_limit() -> None:
    measured = [Measured(1, 10.0, 2.0, 400.0, 1e6), Measured(2, 12.5, 2.0, 500.0, 2e6)]
    assert measured[1].trials_per_hour == pytest.approx(576.0)
    assert computed_trials_per_hour(measured, 100) == pytest.approx(3600.0 * 8.0)
    by_network = 3600.0 * NETWORK_BYTES_PER_S / 2e6
    assert computed_trials_per_hour(measured, 1000) == pytest.approx(by_network)
    light = [Measured(1, 10.0, 2.0, 20.0, 1.0)]
    assert computed_trials_per_hour(light, 1000) == pytest.approx(3600.0 * 20.0)
    assert to_table(measured).row_count == 5


def test_trials_are_measured(tmp_path: Path) -> None:
    found = measure(ScalingOptions(trials=1, items=20, record="none"), 1, tmp_path)
    assert found.trial_s > 0.5 and found.start_s > 0.0
    assert 1.0 < found.items_per_s < 1e5
    assert found.bytes_per_trial > 1000


def test_no_workers_are_refused() -> None:
    with pytest.raises(BadInputError, match=r"--workers is \[0\]; expected counts"):
        ScalingOptions(workers=(0,))
