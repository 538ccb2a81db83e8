"""What trials with mugs are for."""

from dataclasses import replace

import pytest
import tyro

from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from scenarios.mug_hang import MugHangOptions
from scenarios.record_problems import RecordOptions
from scenarios.trials.mug_tasks import MUG_TASK_NAMES, mug_task
from tests.helpers.planning import LYING, STANDING


def test_each_subgoal_has_a_task_and_starts_that_serve_it() -> None:
    assert mug_task(HANG).subgoal == HANG and mug_task(REORIENT).subgoal == REORIENT
    assert mug_task(HANG).reject(STANDING) == "" and mug_task(REORIENT).reject(LYING) == ""
    assert mug_task(REORIENT).reject(STANDING), "a mug that stands is upright already"


def test_a_subgoal_that_no_trial_is_for_is_an_error() -> None:
    with pytest.raises(ValueError, match="no trial with mugs is to throw; expected hang, reorient"):
        mug_task(replace(HANG, name="throw"))


@pytest.mark.parametrize(
    ("options", "flag"), [(MugHangOptions, "--task"), (RecordOptions, "--tasks")]
)
def test_commands_list_and_take_the_tasks_that_there_are(
    options: type, flag: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert MUG_TASK_NAMES == ("hang", "reorient") == RecordOptions().tasks
    with pytest.raises(SystemExit):
        tyro.cli(options, args=["--help"])
    assert "{hang,reorient}" in capsys.readouterr().out
    for name in MUG_TASK_NAMES:
        tyro.cli(options, args=[flag, name])
    with pytest.raises(SystemExit):
        tyro.cli(options, args=[flag, "throw"])
