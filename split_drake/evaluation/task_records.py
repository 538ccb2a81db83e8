"""How a task's samples in one scene are judged: the top-ranked, the accepted ones, and all.

Poses of any task are judged by how near they are to true ones, its symmetry taken into account.
Some tasks have more to pass: `judges` says which.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from split_drake.data.object_scenes import ObjectScene
from split_drake.evaluation.judgement import (
    GOOD_POSITION_M,
    GOOD_ROTATION_RAD,
    GraspJudgement,
    Judgement,
    covered,
    direction_error_rad,
    judge_grasps,
    judge_poses,
    line_error_rad,
    yaw_error_rad,
)
from split_drake.evaluation.record import Scored, TaskRecord
from split_drake.evaluation.scenes import EvalSubject
from split_drake.grasps.free_hand import Fault, FreeHand
from split_drake.pose_set import Acceptance, ScoredPoses
from split_drake.pose_task import PoseTask
from split_drake.poses import Array

# So many accepted grasps a scene are wanted, and so many of them are tried in physics.
WANTED_GRASPS = 30
TRIED_GRASPS = 10

UNREACHABLE = "unreachable"
FAULTS = (UNREACHABLE, *filter(None, get_args(Fault)))


class Ranking:
    """A task's samples in one scene, ranked by their scores.

    Attributes:
        samples: the samples (N).
        accepted: (N,) whether each is accepted.
        top: index of the top-ranked one; None without samples.
    """

    def __init__(self, samples: ScoredPoses, acceptance: Acceptance) -> None:
        self.samples = samples
        self.accepted = acceptance.accepted(samples.scores)
        self.top = int(np.argmax(samples.scores)) if len(samples.scores) else None

    def record(
        self,
        good: NDArray[np.bool_],
        checks: Mapping[str, NDArray[np.bool_]],
        values: Mapping[str, Array],
    ) -> TaskRecord:
        """Return the record of the top-ranked sample and of all.

        Args:
            good, checks: (N,) flags of all samples; a rejected top-ranked one passes no check, and
                none is passed without samples.
            values: (N,) figures of all samples; of none there are none.
        """
        top, accepted = self.top, self.accepted
        flags = {"top_good": good, **checks}
        figures = {} if top is None else {name: float(v[top]) for name, v in values.items()}
        return TaskRecord(
            checks={
                name: top is not None and bool(flag[top] and accepted[top])
                for name, flag in flags.items()
            },
            values={**figures, "accepted": float(accepted.sum())},
            tallies={"samples_good": tally(good), "accepted_good": tally(good[accepted])},
            samples=Scored.of(self.samples.scores, good),
        )


def tally(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Return how many of the flags (N,) are set, and N."""
    return int(flags.sum()), len(flags)


@dataclass(frozen=True)
class Question:
    """What is to be judged: a task's samples in one scene.

    Attributes:
        task: whose poses they are.
        ranking: the samples.
        subject: the object.
        scene: how it lies, and what is seen of it.
        rng: chooses what is tried in physics; None where nothing is.
    """

    task: PoseTask
    ranking: Ranking
    subject: EvalSubject
    scene: ObjectScene
    rng: np.random.Generator | None

    @property
    def X_WPs(self) -> Array:
        """(N, 4, 4): the samples."""
        return self.ranking.samples.X_WPs

    @property
    def X_WTruths(self) -> Array:
        """(M, 4, 4): the true poses, one each of those that mean the same."""
        return self.scene.X_WO @ self.subject.shape.poses_of(self.task)

    def judged(self) -> Judgement:
        """Return how the samples compare with the true poses."""
        return judge_poses(self.X_WPs, self.X_WTruths, self.task.symmetry)


def record_poses(question: Question) -> TaskRecord:
    """Judge the poses of any task by how near they are to true ones."""
    judgement = question.judged()
    return question.ranking.record(judgement.good, checks={}, values=_errors(judgement))


def _errors(judgement: Judgement) -> dict[str, Array]:
    return {
        "position_mm": 1000.0 * judgement.position_m,
        "rotation_deg": np.degrees(judgement.rotation_rad),
    }


def record_handles(question: Question) -> TaskRecord:
    """Judge handle poses of a mug, also by whether a peg along them would be clear of it."""
    peg, X_WO, X_WHs = question.subject.peg, question.scene.X_WO, question.X_WPs
    if peg is None:
        return record_poses(question)
    judgement = question.judged()
    clear = peg.clear(X_WO, X_WHs)
    X_WTrues = question.X_WTruths[judgement.nearest]
    axis = line_error_rad(X_WHs[:, :3, 1], X_WTrues[:, :3, 1])
    return question.ranking.record(
        judgement.good,
        checks={"peg_clear": clear, "peg_clear_axis": clear & (axis < GOOD_ROTATION_RAD)},
        values={**_errors(judgement), "axis_deg": np.degrees(axis)},
    )


def record_uprights(question: Question) -> TaskRecord:
    """Judge upright poses of an object, its axis apart from the yaw about it."""
    X_WUs = question.X_WPs
    judgement = question.judged()
    X_WTrues = question.X_WTruths[judgement.nearest]
    axis = direction_error_rad(X_WUs[:, :3, 2], X_WTrues[:, :3, 2])
    yaw = yaw_error_rad(X_WUs[:, :3, :3], X_WTrues[:, :3, :3])
    stands = (axis < GOOD_ROTATION_RAD) & (judgement.position_m < GOOD_POSITION_M)
    return question.ranking.record(
        judgement.good,
        checks={"axis_good": stands, "axis_yaw_good": stands & (yaw < GOOD_ROTATION_RAD)},
        values={
            **_errors(judgement),
            "axis_deg": np.degrees(axis),
            "yaw_deg": np.degrees(yaw),
        },
    )


def record_grasps(question: Question) -> TaskRecord:
    """Judge grasps of an object by geometry, and some in physics where the question says so."""
    ranking, subject, scene = question.ranking, question.subject, question.scene
    X_WGs, accepted = question.X_WPs, ranking.accepted
    judgement = judge_grasps(X_WGs, subject.judge, scene.X_WO, scene.table_z_m)
    record = ranking.record(judgement.good, checks={}, values={})
    checks = {**record.checks, "enough_accepted": int(accepted.sum()) >= WANTED_GRASPS}
    tallies = dict(record.tallies)
    if subject.true_grasps is not None:
        found = covered(subject.true_grasps.in_scene(scene), X_WGs[accepted])
        tallies["coverage"] = tally(found)
    record = replace(record, checks=checks, tallies=tallies)
    if question.rng is None:
        return record
    trials = GraspTrials(subject.hand, scene.X_WO, X_WGs, judgement)
    return _with_physics(record, ranking, trials, question.rng)


@dataclass(frozen=True)
class GraspTrials:
    """Tries detected grasps in physics.

    Attributes:
        hand: a free hand for the object.
        X_WO: (4, 4) pose of the object on the table.
        X_WGs: (N, 4, 4) the grasps.
        judgement: of them by geometry.
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
        return self.hand.try_in_scene(self.X_WO, self.X_WGs[number], opening_m).fault


def _with_physics(
    record: TaskRecord, ranking: Ranking, trials: GraspTrials, rng: np.random.Generator
) -> TaskRecord:
    """Return the record with the top-ranked and some random accepted grasps tried in physics."""
    accepted = np.flatnonzero(ranking.accepted)
    tried = rng.choice(accepted, min(TRIED_GRASPS, len(accepted)), replace=False)
    faults = [trials.fault(number) for number in tried]
    holds = np.array([not fault for fault in faults], dtype=bool)
    top = ranking.top
    top_holds = top is not None and bool(ranking.accepted[top]) and not trials.fault(top)
    by_fault = {f"tried_{fault}": (faults.count(fault), len(faults)) for fault in FAULTS}
    return replace(
        record,
        checks={**record.checks, "top_holds": top_holds},
        tallies={**record.tallies, "tried_holds": tally(holds), **by_fault},
        tried=Scored.of(ranking.samples.scores[tried], holds),
    )
