"""Rests and checked grasps of an object, made by hand in place of physics."""

import numpy as np

from split_drake.data.rests import Rests
from split_drake.grasps.free_hand import MAX_SLIP_M
from split_drake.grasps.sampling import sample_grasps
from split_drake.grasps.store import CheckedGrasps
from split_drake.objects.task_object import TaskObject
from split_drake.poses import make_pose, rotation_x, rotation_y, rotation_z
from split_drake.station.layout import Layout

# Upright, on the side with a mug's handle beside it, and on the side with the handle up.
R_TOS = (
    np.eye(3),
    rotation_x(np.pi / 2.0) @ rotation_z(0.2),
    rotation_y(-np.pi / 2.0),
)


def make_rests(subject: TaskObject, _layout: Layout | None = None) -> Rests:
    """Return three poses on any table, the middle of the object's bounding box above T."""
    X_TOs = []
    for R_TO in R_TOS:
        p_Ts = subject.body.mesh.vertices @ R_TO.T
        middle = (p_Ts.min(axis=0) + p_Ts.max(axis=0)) / 2.0
        X_TOs.append(make_pose(R_TO, (-middle[0], -middle[1], -p_Ts[:, 2].min())))
    return Rests(np.stack(X_TOs), dropped=len(X_TOs))


def make_checked(subject: TaskObject, count: int = 60) -> CheckedGrasps:
    """Return geometric grasps, of which every fifth is said to slip."""
    labels = sample_grasps(subject.body, np.random.default_rng(0), positives=count, negatives=3)
    holds = np.arange(len(labels.X_OGs)) % 5 > 0
    return CheckedGrasps(
        X_OGs=labels.X_OGs,
        openings_m=labels.openings_m,
        qualities=labels.qualities,
        faults=np.where(holds, "", "slipped"),
        slips_m=np.where(holds, MAX_SLIP_M / 2.0, 2.0 * MAX_SLIP_M),
        turns_rad=np.zeros(len(holds)),
    )
