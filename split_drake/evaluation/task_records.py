"""How a task's samples in one scene fare: the top-ranked one, the accepted ones, and all."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from split_drake.data.mug_scenes import MugScene
from split_drake.evaluation.coverage import covered
from split_drake.evaluation.judgement import (
    GOOD_POSITION_M,
    GOOD_ROTATION_RAD,
    GraspJudgement,
    direction_error_rad,
    judge_grasps,
    judge_poses,
    line_error_rad,
    yaw_error_rad,
)
from split_drake.evaluation.record import Scored, TaskRecord
from split_drake.evaluation.scenes import EvalMug
from split_drake.grasps.free_hand import Fault, FreeHand
from split_drake.poses import Array
from split_drake.split.detector import ScoredSamples

# So many accepted grasps a scene are wanted, and so many of them are tried in physics.
WANTED_GRASPS = 30
TRIED_GRASPS = 10

UNREACHABLE = "unreachable"
FAULTS = (UNREACHABLE, *filter(None, get_args(Fault)))


class Ranking:
    """A task's samples in one scene, ranked by their scores.

    Attributes:
        samples: the samples (N).
        accepted: (N,) whether the evaluator accepts each.
        top: index of the top-ranked one.
    """

    def __init__(self, samples: ScoredSamples, threshold: float) -> None:
        self.samples = samples
        self.accepted: NDArray[np.bool_] = samples.scores >= threshold
        self.top = int(np.argmax(samples.scores))

    def record(
        self,
        good: NDArray[np.bool_],
        checks: Mapping[str, NDArray[np.bool_]],
        values: Mapping[str, Array],
    ) -> TaskRecord:
        """Return the record of the top-ranked sample and of all.

        Args:
            good, checks: (N,) flags of all samples; a rejected top-ranked one passes no check.
            values: (N,) figures of all samples.
        """
        top, accepted = self.top, self.accepted
        flags = {"top_good": good, **checks}
        figures = {name: float(value[top]) for name, value in values.items()}
        return TaskRecord(
            checks={name: bool(flag[top] and accepted[top]) for name, flag in flags.items()},
            values={**figures, "accepted": float(accepted.sum())},
            tallies={"samples_good": tally(good), "accepted_good": tally(good[accepted])},
            samples=Scored.of(self.samples.scores, good),
        )


def tally(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Return how many of the flags (N,) are set, and N."""
    return int(flags.sum()), len(flags)


def record_handles(ranking: Ranking, mug: EvalMug, X_WO: Array) -> TaskRecord:
    """Judge handle poses of a mug at X_WO (4, 4)."""
    X_WHs, X_WTruths = ranking.samples.X_WPs, mug.shape.handle_poses(X_WO)
    judgement = judge_poses(X_WHs, X_WTruths)
    clear = mug.peg.clear(X_WO, X_WHs)
    axis = line_error_rad(X_WHs[:, :3, 1], X_WTruths[0, :3, 1])
    return ranking.record(
        judgement.good,
        checks={"peg_clear": clear, "peg_clear_axis": clear & (axis < GOOD_ROTATION_RAD)},
        values={
            "position_mm": 1000.0 * judgement.position_m,
            "rotation_deg": np.degrees(judgement.rotation_rad),
            "axis_deg": np.degrees(axis),
        },
    )


def record_uprights(ranking: Ranking, X_WO: Array) -> TaskRecord:
    """Judge upright poses of a mug at X_WO (4, 4), the mug's axis apart from the yaw about it."""
    X_WUs = ranking.samples.X_WPs
    judgement = judge_poses(X_WUs, X_WO[None])
    axis = direction_error_rad(X_WUs[:, :3, 2], X_WO[:3, 2])
    yaw = yaw_error_rad(X_WUs[:, :3, :3], X_WO[:3, :3])
    stands = (axis < GOOD_ROTATION_RAD) & (judgement.position_m < GOOD_POSITION_M)
    return ranking.record(
        judgement.good,
        checks={"axis_good": stands, "axis_yaw_good": stands & (yaw < GOOD_ROTATION_RAD)},
        values={
            "position_mm": 1000.0 * judgement.position_m,
            "rotation_deg": np.degrees(judgement.rotation_rad),
            "axis_deg": np.degrees(axis),
            "yaw_deg": np.degrees(yaw),
        },
    )


def record_grasps(
    ranking: Ranking, mug: EvalMug, scene: MugScene, rng: np.random.Generator | None
) -> TaskRecord:
    """Judge grasps of a mug; where there is an `rng` to choose some, these are tried in physics."""
    X_WGs, accepted = ranking.samples.X_WPs, ranking.accepted
    judgement = judge_grasps(X_WGs, mug.judge, scene.X_WO)
    record = ranking.record(judgement.good, checks={}, values={})
    checks = {**record.checks, "enough_accepted": int(accepted.sum()) >= WANTED_GRASPS}
    tallies = dict(record.tallies)
    if mug.true_grasps is not None:
        found = covered(mug.true_grasps.in_scene(scene), X_WGs[accepted])
        tallies["coverage"] = tally(found)
    record = replace(record, checks=checks, tallies=tallies)
    if rng is None:
        return record
    return _with_physics(record, ranking, GraspTrials(mug.hand, scene.X_WO, X_WGs, judgement), rng)


@dataclass(frozen=True)
class GraspTrials:
    """Tries detected grasps in physics.

    Attributes:
        hand: a free hand for the object.
        X_WO: (4, 4) pose of the object on the table.
        X_WGs: (N, 4, 4) the grasps.
        judgement: how they fare geometrically.
    """

    hand: FreeHand
    X_WO: Array
    X_WGs: Array
    judgement: GraspJudgement

    def fault(self, number: int) -> str:
        """Return why grasp `number` fails, an empty string where it holds.

        The hand must come in from above without hitting anything, close, and hold the object while
        it is lifted and shaken.
        """
        if not self.judgement.reachable[number]:
            return UNREACHABLE
        opening_m = float(self.judgement.openings_m[number])
        return self.hand.hold_in_scene(self.X_WO, self.X_WGs[number], opening_m).fault


def _with_physics(
    record: TaskRecord, ranking: Ranking, trials: GraspTrials, rng: np.random.Generator
) -> TaskRecord:
    """Return the record with the top-ranked and some random accepted grasps tried in physics."""
    accepted = np.flatnonzero(ranking.accepted)
    tried = rng.choice(accepted, min(TRIED_GRASPS, len(accepted)), replace=False)
    faults = [trials.fault(number) for number in tried]
    holds = np.array([not fault for fault in faults], dtype=bool)
    top_holds = bool(ranking.accepted[ranking.top]) and not trials.fault(ranking.top)
    by_fault = {f"tried_{fault}": (faults.count(fault), len(faults)) for fault in FAULTS}
    return replace(
        record,
        checks={**record.checks, "top_holds": top_holds},
        tallies={**record.tallies, "tried_holds": tally(holds), **by_fault},
        tried=Scored.of(ranking.samples.scores[tried], holds),
    )
