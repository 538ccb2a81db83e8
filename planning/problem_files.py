"""Planning problems on disk: many in one small npz, with a format version and a checksum.

Coordinates are kept to 0.1 mm and rotation vectors to 0.1 mrad, as 16-bit integers; joint angles
exactly.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from planning.geometry.perceived import DETAIL_VOXEL_M, voxel_centroids
from planning.problem import PlanningProblem
from planning.subgoal import find_subgoal
from split_drake.files import Arrays, UnreadableFileError, interpreting, read_npz, replacing
from split_drake.models_folder import MODELS_FOLDER
from split_drake.pose_set import PoseSet
from split_drake.pose_task import MUG_TASKS, PoseTask
from split_drake.poses import Array, make_pose
from split_drake.station.layout_file import layout_from_json, layout_to_json

FORMAT = 3
# Files of the first format do not say what their tasks are: those of mugs.  Before the third none
# had obstacles.
_FORMATS = (1, 2, FORMAT)
LENGTH_STEP_M = 1e-4
ANGLE_STEP_RAD = 1e-4
SCORE_STEP = 1.0 / np.iinfo(np.uint16).max
_MISSING = -1

_WHAT = "a file of planning problems"
SHIPPED_PROBLEMS = MODELS_FOLDER / "problems" / "mugs.npz"


def compact(
    problem: PlanningProblem, max_poses: Mapping[str, int], otherwise: int
) -> PlanningProblem:
    """Return the problem with its clouds thinned and the best poses of each task.

    Of tasks that `max_poses` does not name `otherwise` poses are kept.

    The default planner thins clouds to the same voxels, so it loses nothing by that; the means of
    modes that it plans with are those of the poses kept.
    """
    sets = {
        name: poses.head(max_poses.get(name, otherwise))
        for name, poses in problem.pose_sets.items()
    }
    return replace(
        problem,
        pose_sets=sets,
        p_WPs=voxel_centroids(problem.p_WPs, DETAIL_VOXEL_M),
        p_WObstacles=voxel_centroids(problem.p_WObstacles, DETAIL_VOXEL_M),
    )


def save_problems(path: Path, problems: Mapping[str, PlanningProblem]) -> None:
    """Write problems by their names, atomically.

    Raises ValueError where a coordinate is beyond the 3.2 m that the format holds, and for
    problems in the midst of a task, of which it holds no trace.
    """
    for name, problem in problems.items():
        if problem.held_width_m is not None or len(problem.X_WGfailed):
            raise ValueError(
                f"problem {name!r} has an object in the hand or grasps that failed before; "
                "expected the first problem of a task"
            )
    arrays = _to_arrays(list(problems), list(problems.values()))
    arrays |= {"format": np.array(FORMAT), "sha256": np.array(_checksum(arrays))}
    with replacing(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **arrays)


def load_problems(path: Path | str) -> dict[str, PlanningProblem]:
    """Return {name: problem} as written by `save_problems`, in the same order.

    Raises MissingFileError, and UnreadableFileError where the file is damaged, of another format,
    or no collection of problems.
    """
    arrays = read_npz(path, _WHAT)
    found = arrays.pop("format", np.array(None)).tolist()
    if found not in _FORMATS:
        raise UnreadableFileError(f"{path} has format {found}; expected {FORMAT}")
    checksum = str(arrays.pop("sha256", ""))
    if checksum != _checksum(arrays):
        raise UnreadableFileError(
            f"{path} is damaged: its content does not match its SHA-256 {checksum!r}"
        )
    with interpreting(path, _WHAT):
        return _from_arrays(arrays)


def _to_arrays(names: Sequence[str], problems: Sequence[PlanningProblem]) -> Arrays:
    layouts = [layout_to_json(problem.layout) for problem in problems]
    distinct = list(dict.fromkeys(layouts))
    arrays: Arrays = {
        "names": np.array(names, dtype=np.str_),
        "subgoals": np.array([problem.subgoal.name for problem in problems], dtype=np.str_),
        "layouts": np.array(distinct, dtype=np.str_),
        "layout_of": np.array([distinct.index(layout) for layout in layouts], dtype=np.int32),
        "q_starts": np.array([problem.q_start for problem in problems]).reshape(-1, 7),
        **_cloud_arrays("cloud", [problem.p_WPs for problem in problems]),
        **_cloud_arrays("obstacles", [problem.p_WObstacles for problem in problems]),
    }
    tasks = _tasks_of(problems)
    arrays["tasks"] = np.array(json.dumps([asdict(task) for task in tasks]))
    for task in tasks:
        arrays |= _task_arrays(task, [problem.pose_sets.get(task.name) for problem in problems])
    return arrays


def _cloud_arrays(name: str, clouds: Sequence[Array]) -> Arrays:
    """Return clouds (N, 3) of all problems, one after the other, and how many points each has."""
    kept = [_quantised(cloud, LENGTH_STEP_M) for cloud in clouds]
    return {
        name: np.concatenate([np.empty((0, 3), np.int16), *kept]),
        f"{name}_counts": np.array([len(cloud) for cloud in kept], dtype=np.int32),
    }


def _tasks_of(problems: Sequence[PlanningProblem]) -> tuple[PoseTask, ...]:
    """Return the tasks of all problems; raise ValueError where two of one name differ."""
    found: dict[str, PoseTask] = {}
    for problem in problems:
        for name, poses in problem.pose_sets.items():
            if found.setdefault(name, poses.task) != poses.task:
                raise ValueError(f"two tasks are called {name!r}: {found[name]} and {poses.task}")
    return tuple(found.values())


def _tasks_in(arrays: Arrays) -> tuple[PoseTask, ...]:
    """Return the tasks of a file."""
    if "tasks" not in arrays:
        return MUG_TASKS
    return tuple(PoseTask.from_fields(fields) for fields in json.loads(str(arrays["tasks"])))


def _task_arrays(task: PoseTask, pose_sets: Sequence[PoseSet | None]) -> Arrays:
    """Return the poses of one task as positions and rotation vectors, (M, 6) for all problems."""
    present = [poses for poses in pose_sets if poses is not None]
    X_WPs = np.concatenate([np.empty((0, 4, 4)), *(poses.X_WPs for poses in present)])
    turns = Rotation.from_matrix(X_WPs[:, :3, :3]).as_rotvec() if len(X_WPs) else X_WPs[:, :3, 3]
    scores = np.concatenate([np.empty(0), *(poses.scores for poses in present)])
    counts = [_MISSING if poses is None else len(poses) for poses in pose_sets]
    return {
        f"{task}/p_WPs": _quantised(X_WPs[:, :3, 3], LENGTH_STEP_M),
        f"{task}/turns": _quantised(turns, ANGLE_STEP_RAD),
        f"{task}/scores": np.round(scores / SCORE_STEP).astype(np.uint16),
        f"{task}/counts": np.array(counts, dtype=np.int32),
    }


def _from_arrays(arrays: Arrays) -> dict[str, PlanningProblem]:
    layouts = [layout_from_json(str(text)) for text in arrays["layouts"]]
    clouds = _clouds("cloud", arrays)
    obstacles = _clouds("obstacles", arrays) if "obstacles" in arrays else None
    sets = {task.name: _pose_sets(task, arrays) for task in _tasks_in(arrays)}
    problems = {}
    for index, name in enumerate(arrays["names"]):
        found = {name: poses for name in sets if (poses := sets[name][index]) is not None}
        problems[str(name)] = PlanningProblem(
            subgoal=find_subgoal(str(arrays["subgoals"][index])),
            pose_sets=found,
            p_WPs=clouds[index],
            q_start=arrays["q_starts"][index],
            layout=layouts[arrays["layout_of"][index]],
            p_WObstacles=np.empty((0, 3)) if obstacles is None else obstacles[index],
        )
    return problems


def _pose_sets(task: PoseTask, arrays: Arrays) -> list[PoseSet | None]:
    turns = arrays[f"{task}/turns"] * ANGLE_STEP_RAD
    R_WPs = Rotation.from_rotvec(turns).as_matrix() if len(turns) else np.empty((0, 3, 3))
    X_WPs = make_pose(R_WPs, arrays[f"{task}/p_WPs"] * LENGTH_STEP_M)
    scores = np.minimum(arrays[f"{task}/scores"] * SCORE_STEP, 1.0)
    counts = arrays[f"{task}/counts"]
    pieces = zip(counts, _split(X_WPs, counts), _split(scores, counts), strict=True)
    return [None if n == _MISSING else PoseSet(task, X, score) for n, X, score in pieces]


def _clouds(name: str, arrays: Arrays) -> list[Array]:
    """Return the cloud (N, 3) of each problem, as `_cloud_arrays` wrote it."""
    return _split(arrays[name] * LENGTH_STEP_M, arrays[f"{name}_counts"])


def _split(rows: Array, counts: NDArray) -> list[Array]:
    """Return the rows (M, ...) of each problem; `counts` (N,) may be `_MISSING`."""
    ends = np.cumsum(np.maximum(counts, 0))
    if (total := int(np.maximum(counts, 0).sum())) != len(rows):
        raise ValueError(f"{len(rows)} rows are split by counts of {total} in all")
    return np.split(rows, ends[:-1]) if len(counts) else []


def _quantised(values: Array, step: float) -> NDArray[np.int16]:
    steps = np.round(np.asarray(values, dtype=float) / step)
    limits = np.iinfo(np.int16)
    if len(steps) and not (limits.min <= steps.min() and steps.max() <= limits.max):
        raise ValueError(
            f"a value of {np.abs(values).max():.3g} cannot be kept in steps of {step}; expected at "
            f"most {limits.max * step:.3g}"
        )
    return steps.astype(np.int16)


def _checksum(arrays: Arrays) -> str:
    """Return the SHA-256 over names, types, shapes and bytes of all arrays."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
