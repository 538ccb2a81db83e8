"""By what each task is judged, and what is told of it; a task of its own is a value here."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from split_drake.evaluation.record import TaskRecord
from split_drake.evaluation.task_records import (
    Question,
    record_grasps,
    record_handles,
    record_poses,
    record_uprights,
)
from split_drake.objects.task_object import TaskObject
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask


@dataclass(frozen=True)
class TaskJudge:
    """How a task is judged.

    Attributes:
        record: judges the task's samples in one scene.
        needs_true_poses: whether it asks objects for true poses of the task.
        main_checks: (check, group of scenes) that tables show of each object.
    """

    record: Callable[[Question], TaskRecord] = record_poses
    needs_true_poses: bool = True
    main_checks: tuple[tuple[str, str], ...] = (("top_good", "all"),)


# Tasks that are judged by other things than how near their poses are to true ones, in the order of
# the tables' columns.
JUDGES: Mapping[PoseTask, TaskJudge] = {
    HANDLE: TaskJudge(
        record_handles, main_checks=(("top_good", "visible"), ("peg_clear_axis", "visible"))
    ),
    UPRIGHT: TaskJudge(record_uprights, main_checks=(("axis_good", "all"),)),
    GRASP: TaskJudge(record_grasps, needs_true_poses=False),
}


def judge_of(task: PoseTask) -> TaskJudge:
    """Return the judge of a task: its own, or the one of nearness alone."""
    return JUDGES.get(task, TaskJudge())


def record_task(question: Question) -> TaskRecord:
    """Judge a task's samples in one scene."""
    return judge_of(question.task).record(question)


def main_checks(tasks: Sequence[PoseTask]) -> list[tuple[PoseTask, str, str]]:
    """Return (task, check, group of scenes) that are told of each object, own judges first."""
    own = [task for task in JUDGES if task in tasks]
    others = [task for task in tasks if task not in JUDGES]
    return [(task, *told) for task in (*own, *others) for told in judge_of(task).main_checks]


def require_true_poses(tasks: Iterable[PoseTask], shape: TaskObject) -> None:
    """Raise UnknownTaskError where an object lacks true poses that a task is judged by."""
    for task in tasks:
        if judge_of(task).needs_true_poses:
            shape.poses_of(task)
