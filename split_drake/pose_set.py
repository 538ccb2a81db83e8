"""Pose sets: what a detector returns and a planner takes."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from split_drake.bad_input import BadInputError, require_numbers
from split_drake.files import Arrays, UnreadableFileError, interpreting, read_npz, replacing
from split_drake.pose_task import MUG_TASKS, PoseTask
from split_drake.poses import Array, check_poses, rounded_poses

if TYPE_CHECKING:
    from split_drake.scene import Scene

# What a network computes differs by 2e-7 from one processor to another.  Digits that are much
# larger leave few values that are rounded up on one of them and down on another.
_POSITION_DECIMALS, _ROTATION_DECIMALS, _SCORE_DECIMALS = 4, 3, 3


@dataclass(frozen=True)
class PoseSet:
    """Poses for one task in one scene, best first.

    Attributes:
        task: what the poses are for.
        X_WPs: (N, 4, 4) poses in the world, N >= 0.
        scores: (N,) in [0, 1], descending.  They rank poses and are no probabilities; true handle
            and upright poses all have 1.
        reason: why there are no poses, of an empty set whose detector says so.
    """

    task: PoseTask
    X_WPs: Array
    scores: Array
    reason: str = ""

    def __post_init__(self) -> None:
        given = np.asarray(self.X_WPs, dtype=float)
        if not given.size:
            given = np.empty((0, 4, 4))
        poses = check_poses(given, f"X_WPs of {self.task}").reshape(-1, 4, 4)
        scores = np.asarray(self.scores, dtype=float)
        if scores.shape != (len(poses),):
            raise ValueError(f"scores have shape {scores.shape}; expected ({len(poses)},)")
        if not np.all((scores >= 0.0) & (scores <= 1.0)):
            wrong = scores[~((scores >= 0.0) & (scores <= 1.0))][0]
            raise ValueError(f"a score of {self.task} is {wrong}; expected [0, 1]")
        if np.any(np.diff(scores) > 0.0):
            at = int(np.argmax(np.diff(scores) > 0.0))
            raise ValueError(
                f"scores of {self.task} do not descend: {scores[at]:.4f} is followed by "
                f"{scores[at + 1]:.4f}; use PoseSet.ranked"
            )
        if self.reason and len(poses):
            raise ValueError(
                f"{len(poses)} poses of {self.task} have a reason why there are none: {self.reason}"
            )
        object.__setattr__(self, "X_WPs", poses)
        object.__setattr__(self, "scores", scores)

    @classmethod
    def ranked(cls, task: PoseTask, X_WPs: Array, scores: Array) -> Self:
        """Return the set with its poses (N, 4, 4) and scores (N,) sorted, best first.

        Raises BadInputError where there are not as many scores as poses.
        """
        poses, values = np.asarray(X_WPs), np.asarray(scores, dtype=float)
        if not poses.ndim:
            raise BadInputError(f"X_WPs of {task} is {poses}; expected (N, 4, 4) poses")
        if values.shape != (len(poses),):
            raise BadInputError(
                f"{len(poses)} poses of {task} have scores of shape {values.shape}; expected "
                f"({len(poses)},), a score for each pose"
            )
        order = np.argsort(-values, kind="stable")
        return cls(task, poses[order], values[order])

    def __len__(self) -> int:
        return len(self.scores)

    def head(self, count: int) -> Self:
        """Return the best `count` poses (all of them where there are fewer)."""
        if count < 0:
            raise BadInputError(f"count is {count}; expected how many poses to keep, 0 or more")
        return replace(self, X_WPs=self.X_WPs[:count], scores=self.scores[:count])

    def subset(self, kept: NDArray[np.bool_]) -> Self:
        """Return the poses that `kept` (N,), booleans, marks."""
        if np.asarray(kept).dtype != bool or np.shape(kept) != (len(self),):
            raise BadInputError(
                f"kept has shape {np.shape(kept)} and type {np.asarray(kept).dtype}; expected "
                f"({len(self)},) booleans, one for each pose"
            )
        return replace(self, X_WPs=self.X_WPs[kept], scores=self.scores[kept])

    def moved(self, X_WMoved: Array) -> Self:
        """Return the set after everything has moved by X_WMoved (4, 4), given in W."""
        return replace(self, X_WPs=X_WMoved @ self.X_WPs)


_WHAT = "a file of pose sets: 'cloud' and '<task>/X_WPs', '<task>/scores'"

# By the names of their tasks.
PoseSets = Mapping[str, PoseSet]


@dataclass(frozen=True)
class ScoredPoses:
    """Poses that were drawn for one task, before any is rejected.

    Attributes:
        X_WPs: (N, 4, 4) poses in W, in no order.
        scores: (N,) in [0, 1]; higher is better.
    """

    X_WPs: Array
    scores: Array


class PoseDetector(Protocol):
    """Finds poses in a scene: SPLIT, the oracle, or a baseline."""

    def detect(
        self, scene: "Scene", tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return a pose set for each of `tasks`, by their names; empty where nothing was found.

        Raises UnknownTaskError naming the tasks that the detector knows, for any other.
        """
        ...


@dataclass(frozen=True)
class Acceptance:
    """Which poses are accepted, by their scores.

    Attributes:
        least: what is scored lower is not accepted.
        enough: what is scored so high is.
        of_best: where not even the best pose is clearly better than `enough`, this share of its
            score is enough: what is hard to see has lower scores, all of them.

    Raises BadInputError where a score is not within [0, 1), or the least is more than enough.
    """

    least: float
    enough: float
    of_best: float = 0.9

    def __post_init__(self) -> None:
        require_numbers(self)
        if not 0.0 <= self.least <= self.enough < 1.0 or not 0.0 <= self.of_best <= 1.0:
            raise BadInputError(
                f"least is {self.least}, enough {self.enough} and of_best {self.of_best}; expected "
                "scores from 0 to below 1, no less enough than least, and a share"
            )

    def accepted(self, scores: Array) -> NDArray[np.bool_]:
        """Return (N,) which poses are accepted, by all their scores (N,)."""
        best = float(np.max(scores, initial=0.0))
        bound = max(self.least, min(self.enough, self.of_best * best))
        return np.asarray(scores >= bound)


ALL_ACCEPTED = Acceptance(0.0, 0.0)


@runtime_checkable
class SamplingDetector(PoseDetector, Protocol):
    """A detector that draws and scores poses, and accepts some of them."""

    @property
    def acceptance(self) -> Acceptance:
        """Which scores are accepted."""
        ...

    def sample(
        self, scene: "Scene", tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, ScoredPoses]:
        """Return all poses drawn for each of `tasks`, by their names, accepted or not."""
        ...


def accepted_poses(
    drawn: Mapping[str, ScoredPoses], tasks: Sequence[PoseTask], acceptance: Acceptance
) -> dict[str, PoseSet]:
    """Return the sets of those poses that are accepted, by the tasks' names.

    Poses and scores are rounded.  The last bits of a network's sums differ between processors, and
    a planner would make other plans of them.
    """
    found = {}
    for task in tasks:
        poses = drawn[task.name]
        scores = np.round(poses.scores, _SCORE_DECIMALS)
        good = acceptance.accepted(scores)
        X_WPs = rounded_poses(poses.X_WPs[good], _POSITION_DECIMALS, _ROTATION_DECIMALS)
        ranked = PoseSet.ranked(task, X_WPs, scores[good])
        found[task.name] = replace(ranked, reason=_why_none(scores, acceptance.least))
    return found


def _why_none(scores: Array, least: float) -> str:
    """Return why no pose was accepted; nothing where one was."""
    if not len(scores):
        return "no pose was drawn"
    if scores.max() >= least:
        return ""
    return (
        f"none of {len(scores)} poses drawn was accepted: the best has a score of "
        f"{scores.max():.3f}, the least that is accepted is {least:g}"
    )


def merged_pose_sets(parts: Sequence[PoseSets]) -> dict[str, PoseSet]:
    """Return the poses of all parts by their tasks' names, best first.

    A set that is empty in all parts keeps their reasons.  Raises ValueError where two parts have
    different tasks, or there is none.
    """
    if len({tuple(sets) for sets in parts}) != 1:
        raise ValueError(f"tasks are {[list(sets) for sets in parts]}; expected the same in each")
    return {name: _merged([sets[name] for sets in parts]) for name in parts[0]}


def _merged(parts: Sequence[PoseSet]) -> PoseSet:
    merged = PoseSet.ranked(
        parts[0].task,
        np.concatenate([part.X_WPs for part in parts]),
        np.concatenate([part.scores for part in parts]),
    )
    if len(merged):
        return merged
    return replace(merged, reason="; ".join(dict.fromkeys(p.reason for p in parts if p.reason)))


def save_pose_sets(path: Path | str, pose_sets: PoseSets, p_WPs: Array) -> None:
    """Write pose sets and the cloud `p_WPs` (N, 3) they were found in to an npz, atomically.

    Each is written by its own task's name, whatever its key.  Raises ValueError where two are of
    tasks of one name, or where the cloud is none.
    """
    tasks = [asdict(pose_set.task) for pose_set in pose_sets.values()]
    names = [pose_set.task.name for pose_set in pose_sets.values()]
    if len(set(names)) < len(names):
        raise ValueError(f"pose sets are of the tasks {', '.join(names)}; expected one of each")
    arrays: Arrays = {
        "cloud": np.asarray(p_WPs, dtype=np.float32),
        "tasks": np.array(json.dumps(tasks)),
    }
    _cloud_in(arrays)  # refuses what could not be loaded again
    for pose_set in pose_sets.values():
        arrays[f"{pose_set.task}/X_WPs"] = pose_set.X_WPs
        arrays[f"{pose_set.task}/scores"] = pose_set.scores
        if pose_set.reason:
            arrays[f"{pose_set.task}/reason"] = np.array(pose_set.reason)
    with replacing(Path(path)) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)


def load_pose_sets(path: Path | str) -> tuple[dict[str, PoseSet], Array]:
    """Return ({task name: PoseSet}, cloud (N, 3)) as written by `save_pose_sets`.

    Raises MissingFileError, and UnreadableFileError where the file is damaged or no pose-set
    archive, lacks poses of a task that it lists, or holds what is no pose, score or point.
    """
    arrays = read_npz(path, _WHAT, required=("cloud",))
    with interpreting(path, _WHAT):
        sets = {task.name: _set_in(arrays, task, path) for task in _tasks_in(arrays)}
        return sets, _cloud_in(arrays)


def _set_in(arrays: Arrays, task: PoseTask, path: Path | str) -> PoseSet:
    names = f"{task}/X_WPs", f"{task}/scores"
    if missing := [name for name in names if name not in arrays]:
        raise UnreadableFileError(
            f"{path} lists the task {task}, but has no {' and no '.join(missing)}"
        )
    poses, scores = (arrays[name] for name in names)
    if poses.shape != (len(poses), 4, 4):
        raise ValueError(f"{names[0]} has shape {poses.shape}; expected (N, 4, 4)")
    return PoseSet(task, poses, scores, str(arrays.get(f"{task}/reason", "")))


def _cloud_in(arrays: Arrays) -> Array:
    cloud = arrays["cloud"]
    if cloud.ndim != 2 or cloud.shape[1] != 3 or cloud.dtype.kind not in "fiu":
        raise ValueError(
            f"cloud has shape {cloud.shape} and type {cloud.dtype}; expected (N, 3) numbers"
        )
    if not np.isfinite(cloud).all():
        raise ValueError("cloud holds NaN or infinite values; expected points in metres")
    return cloud.astype(float)


def _tasks_in(arrays: Arrays) -> Sequence[PoseTask]:
    """Return the tasks of an archive; those of mugs that it has where it is too old to say."""
    if "tasks" not in arrays:
        return [task for task in MUG_TASKS if f"{task}/X_WPs" in arrays]
    return [PoseTask.from_fields(fields) for fields in json.loads(str(arrays["tasks"]))]
