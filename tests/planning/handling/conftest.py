"""What tests of handling share."""

import pytest

from planning.execution.executor import ExecutionResult
from planning.handling.recovery import Recovery


@pytest.fixture(autouse=True)
def no_room_below(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing be lowered on: a `PerfectRobot` feels no table on which an object would stand."""
    monkeypatch.setattr(Recovery, "lower_on", lambda *_: ExecutionResult(True, ()))
