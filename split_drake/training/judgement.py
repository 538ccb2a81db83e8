"""Which detected poses are good, and how a task fares over scenes.

A handle or upright pose counts as good within 1 cm and 15 degrees of a true one, a grasp where it
would hold the mug geometrically and collides with neither mug nor table.  Where the evaluator
rejects all samples, the top-ranked one counts as not good.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from split_drake.data.grasp_judge import GraspJudge, feasible
from split_drake.poses import Array, invert_pose, rotation_error_rad

GOOD_POSITION_M = 0.01
GOOD_ROTATION_RAD = np.radians(15.0)


@dataclass(frozen=True)
class Judgement:
    """How a task's samples in one scene compare with the truth.

    Attributes:
        good: (N,) whether each sample is.
        position_m, rotation_rad: (N,) errors to the nearest true pose; empty for grasps, of which
            the data set lists only some.
    """

    good: NDArray[np.bool_]
    position_m: Array
    rotation_rad: Array


def judge_poses(X_WPs: Array, X_WTruths: Array) -> Judgement:
    """Compare poses (N, 4, 4) with equivalent true poses (M, 4, 4), each with the nearest."""
    position = np.linalg.norm(X_WPs[:, None, :3, 3] - X_WTruths[None, :, :3, 3], axis=-1)
    rotation = rotation_error_rad(X_WPs[:, None, :3, :3], X_WTruths[None, :, :3, :3])
    good = (position < GOOD_POSITION_M) & (rotation < GOOD_ROTATION_RAD)
    nearest = np.argmin(position / GOOD_POSITION_M + rotation / GOOD_ROTATION_RAD, axis=1)
    rows = np.arange(len(X_WPs))
    return Judgement(good.any(axis=1), position[rows, nearest], rotation[rows, nearest])


def judge_grasps(X_WGs: Array, judge: GraspJudge, X_WO: Array) -> Judgement:
    """Check grasps (N, 4, 4) of the object of `judge`, at X_WO, geometrically."""
    X_OGs = invert_pose(X_WO) @ X_WGs
    check = judge.check(X_OGs)
    good = check.good & feasible(X_WO, X_OGs, check.openings_m)
    return Judgement(good, np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class TaskOutcome:
    """A task in one scene.

    Attributes:
        top_good: whether the top-ranked sample is good, and not rejected.
        top_position_m, top_rotation_rad: its errors, rejected or not; NaN for grasps.
        good_share: share of all samples, before any is rejected, that are good.
        kept: samples that the evaluator does not reject.
        kept_good_share: share of those that are good; NaN where none is left.
        handle_visible: whether the cloud shows the handle.
    """

    top_good: bool
    top_position_m: float
    top_rotation_rad: float
    good_share: float
    kept: int
    kept_good_share: float
    handle_visible: bool


def outcome(scores: Array, judgement: Judgement, threshold: float, visible: bool) -> TaskOutcome:
    """Summarise a task's samples in one scene."""
    top = int(np.argmax(scores))
    kept = scores >= threshold
    measured = judgement.position_m.size > 0
    return TaskOutcome(
        top_good=bool(judgement.good[top] and kept[top]),
        top_position_m=float(judgement.position_m[top]) if measured else np.nan,
        top_rotation_rad=float(judgement.rotation_rad[top]) if measured else np.nan,
        good_share=float(judgement.good.mean()),
        kept=int(kept.sum()),
        kept_good_share=float(judgement.good[kept].mean()) if kept.any() else np.nan,
        handle_visible=visible,
    )


def _mean(values: list[float]) -> float | None:
    """Return the mean of the values that are not NaN, None where there are none."""
    measured = [value for value in values if not np.isnan(value)]
    return float(np.mean(measured)) if measured else None


def _median(values: list[float], unit: float = 1.0) -> float | None:
    """Return the median, in `unit`s, of the values that are not NaN, None where there are none."""
    measured = [value for value in values if not np.isnan(value)]
    return float(np.median(measured)) / unit if measured else None


def summarize(outcomes: list[TaskOutcome]) -> dict[str, float | None]:
    """Return means and medians over scenes; None stands for what was not measured."""
    return {
        "top_good": _mean([o.top_good for o in outcomes]),
        "top_good_handle_visible": _mean([o.top_good for o in outcomes if o.handle_visible]),
        "top_good_handle_hidden": _mean([o.top_good for o in outcomes if not o.handle_visible]),
        "median_position_mm": _median([o.top_position_m for o in outcomes], 1e-3),
        "median_rotation_deg": _median([o.top_rotation_rad for o in outcomes], np.pi / 180.0),
        "samples_good": _mean([o.good_share for o in outcomes]),
        "kept_good": _mean([o.kept_good_share for o in outcomes]),
        "median_kept": _median([o.kept for o in outcomes]),
        "none_kept": _mean([o.kept == 0 for o in outcomes]),
    }
