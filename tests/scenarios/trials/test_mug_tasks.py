"""What trials with mugs are for."""

from dataclasses import replace

import pytest

from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from scenarios.trials.mug_tasks import mug_task
from tests.helpers.planning import LYING, STANDING


def test_each_subgoal_has_a_task_and_starts_that_serve_it() -> None:
    assert mug_task(HANG).subgoal == HANG and mug_task(REORIENT).subgoal == REORIENT
    assert mug_task(HANG).reject(STANDING) == "" and mug_task(REORIENT).reject(LYING) == ""
    assert mug_task(REORIENT).reject(STANDING), "a mug that stands is upright already"


def test_a_subgoal_that_no_trial_is_for_is_an_error() -> None:
    with pytest.raises(ValueError, match="no trial with mugs is to throw; expected hang, reorient"):
        mug_task(replace(HANG, name="throw"))
