"""A mug to evaluate on whose rests and grasps are not read from files, and records by hand."""

import numpy as np

from split_drake.data.rests import Rests
from split_drake.evaluation.record import SceneRecord, Scored, TaskRecord
from split_drake.evaluation.scenes import EvalSubject, TrueGrasps
from split_drake.grasps.sampling import sample_grasps
from split_drake.grasps.store import CheckedGrasps
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.task_object import TaskObject
from split_drake.pose_task import MUG_TASKS
from split_drake.poses import make_pose, rotation_z
from split_drake.station.layout import Layout

GRASPS = 60


def standing(shape: TaskObject, true_grasps: TrueGrasps | None = None) -> EvalSubject:
    """Return an object that stands upright in all scenes, turned in one of three ways."""
    turns = np.stack([rotation_z(angle) for angle in (0.0, 1.0, 2.0)])
    return EvalSubject(shape, Rests(make_pose(turns), dropped=3), Layout(), true_grasps)


def standing_mug() -> EvalSubject:
    """Return a mug that stands upright in all scenes; half of its checked grasps hold."""
    shape = load_mug("test_000")
    labels = sample_grasps(shape.body, np.random.default_rng(0), positives=GRASPS, negatives=3)
    grasps = CheckedGrasps(
        X_OGs=labels.X_OGs,
        openings_m=labels.openings_m,
        qualities=labels.qualities,
        faults=np.where(np.arange(GRASPS) % 2, "slipped", ""),
        slips_m=np.zeros(GRASPS),
        turns_rad=np.zeros(GRASPS),
    )
    return standing(shape, TrueGrasps(shape, grasps))


def scene_record(index: int, good: bool = True, feature_points: int = 100) -> SceneRecord:
    """Return a record of two samples a task, the top-ranked one `good` or not, the other not."""
    task = TaskRecord(
        checks={"top_good": good},
        values={"position_mm": 1.0 + index, "rotation_deg": 2.0, "axis_deg": 1.5},
        tallies={"samples_good": (int(good), 2)},
        samples=Scored.of(np.array([0.9, 0.2]), np.array([good, False])),
    )
    return SceneRecord(
        index=index,
        subject=f"mug_{index % 2}",
        feature_points=feature_points,
        detect_s=0.1,
        tasks={mug_task.name: task for mug_task in MUG_TASKS},
    )
