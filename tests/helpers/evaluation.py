"""A mug to evaluate on whose rests and grasps are not read from files, and records by hand."""

import numpy as np

from split_drake.data.rests import Rests
from split_drake.evaluation.record import SceneRecord, Scored, TaskRecord
from split_drake.evaluation.scenes import EvalMug, TrueGrasps
from split_drake.grasps.sampling import sample_grasps
from split_drake.grasps.store import CheckedGrasps
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import PoseTask
from split_drake.poses import make_pose, rotation_z

GRASPS = 60


def standing_mug() -> EvalMug:
    """Return a mug that stands upright in all scenes; half of its checked grasps hold."""
    shape = load_mug("test_000")
    labels = sample_grasps(shape, np.random.default_rng(0), positives=GRASPS, negatives=3)
    grasps = CheckedGrasps(
        X_OGs=labels.X_OGs,
        openings_m=labels.openings_m,
        qualities=labels.qualities,
        faults=np.where(np.arange(GRASPS) % 2, "slipped", ""),
        slips_m=np.zeros(GRASPS),
        turns_rad=np.zeros(GRASPS),
    )
    turns = np.stack([rotation_z(angle) for angle in (0.0, 1.0, 2.0)])
    rests = Rests(make_pose(turns), dropped=3)
    return EvalMug(shape, rests, TrueGrasps(shape, grasps))


def scene_record(index: int, good: bool = True, handle_points: int = 100) -> SceneRecord:
    """Return a record of two samples a task, the top-ranked one `good` or not, the other not."""
    task = TaskRecord(
        checks={"top_good": good},
        values={"position_mm": 1.0 + index, "rotation_deg": 2.0, "axis_deg": 1.5},
        tallies={"samples_good": (int(good), 2)},
        samples=Scored.of(np.array([0.9, 0.2]), np.array([good, False])),
    )
    return SceneRecord(
        index=index,
        mug=f"mug_{index % 2}",
        handle_points=handle_points,
        detect_s=0.1,
        tasks=dict.fromkeys(PoseTask, task),
    )
