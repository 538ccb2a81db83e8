"""What trials with mugs are for: a subgoal, which starts serve it, and when it is reached."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.handling.attempts import SequenceResult
from planning.subgoal import Subgoal
from split_drake.objects.mug_shape import MugShape
from split_drake.poses import Array
from split_drake.station.station import Station
from split_drake.truth.starts import reject_for_hang, reject_for_reorient
from split_drake.truth.state import Truth
from split_drake.truth.verdicts import Verdict, hang_verdict, reorient_verdict


@dataclass(frozen=True)
class MugTask:
    """A task of trials with mugs.

    Attributes:
        subgoal: to be reached.
        reject: why a start X_WO (4, 4) does not serve the task; "" where it does.
        judge: whether a completed sequence has reached it, by the simulator's truth.
    """

    subgoal: Subgoal
    reject: Callable[[Array], str]
    judge: Callable[[Station, Truth, MugShape, SequenceResult], Verdict]


def _judge_hanging(
    station: Station, truth: Truth, mug: MugShape, result: SequenceResult
) -> Verdict:
    execution = result.attempts[-1].execution
    assert execution is not None  # the sequence was completed
    return hang_verdict(station, truth, mug, station.time_s - execution.since_release_s)


def _judge_standing(
    station: Station, truth: Truth, mug: MugShape, result: SequenceResult
) -> Verdict:
    return reorient_verdict(station, truth)


_TASKS = {
    task.subgoal.name: task
    for task in (
        MugTask(HANG, reject_for_hang, _judge_hanging),
        MugTask(REORIENT, reject_for_reorient, _judge_standing),
    )
}

MUG_TASK_NAMES = tuple(_TASKS)
# What commands take and list in their help; to mypy, which knows no tuple of names, any name.
if TYPE_CHECKING:
    MugTaskName = str
else:
    MugTaskName = Literal[MUG_TASK_NAMES]


def mug_task(subgoal: Subgoal) -> MugTask:
    """Return the task of a subgoal; raise ValueError where no trial with mugs is for it."""
    if subgoal.name not in _TASKS:
        raise ValueError(f"no trial with mugs is to {subgoal}; expected {', '.join(_TASKS)}")
    return _TASKS[subgoal.name]
