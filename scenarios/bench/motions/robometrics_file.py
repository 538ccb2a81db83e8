"""Motion problems in the keys of robometrics, which MotionBenchMaker's problems come in.

A YAML file maps names of sets to lists of problems::

    bookshelf_small_panda:
      - start: [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
        goal_pose: {frame: panda_hand, position_xyz: [..], quaternion_wxyz: [..]}
        goal_ik: [[..7..], ..]                     # may be missing
        obstacles:
          cuboid: {shelf: {dims: [x, y, z], pose: [x, y, z, qw, qx, qy, qz]}}
          cylinder: {can: {radius: r, height: h, pose: [..]}}
        attached: {cuboid: ..., cylinder: ...}     # in the frame of the goal; this project's own

Metres and radians; poses are in the frame of the robot's base.  Keys that say nothing of the
problem (`collision_buffer_ik`, `world_frame`) are left alone, and written as robometrics has them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from scenarios.bench.motions.problem import MotionProblem
from split_drake.bad_input import BadInputError
from split_drake.files import interpreting, replacing
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, invert_pose, make_pose
from split_drake.robot.gripper import HAND_TO_GRIPPER_M
from split_drake.sensing.yaml_file import Fields, numbers, read_yaml, require_keys

WHAT = "motion problems, see scenarios/bench/motions/robometrics_file.py"
FRAME, WORLD_FRAME = "panda_hand", "panda_link0"
X_HG = make_pose(p=(0.0, 0.0, HAND_TO_GRIPPER_M))
_KEYS = (
    "start",
    "goal_pose",
    "goal_ik",
    "obstacles",
    "attached",
    "collision_buffer_ik",
    "world_frame",
)
_KINDS = ("cuboid", "cylinder")


def read_motion_problems(path: Path | str) -> dict[str, MotionProblem]:
    """Return {name: problem} of a file; a problem is called by its set and its number there.

    Raises MissingFileError, and UnreadableFileError or BadInputError naming what cannot be used.
    """
    sets = read_yaml(path, WHAT)
    problems: dict[str, MotionProblem] = {}
    with interpreting(Path(path), WHAT):
        for name, listed in sets.items():
            if not isinstance(listed, Sequence) or isinstance(listed, str):
                raise BadInputError(f"{name} is {listed!r:.60}; expected a list of problems")
            for number, given in enumerate(listed):
                known = f"{name}-{number}"
                problems[known] = _problem(known, given)
    if not problems:
        raise BadInputError(f"{path} has no problems; expected {WHAT}")
    return problems


def write_motion_problems(path: Path | str, sets: Mapping[str, Sequence[MotionProblem]]) -> None:
    """Write problems, set by set, at once or not at all; what `read_motion_problems` reads."""
    content = {name: [_fields(problem) for problem in listed] for name, listed in sets.items()}
    with replacing(Path(path)) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def _problem(name: str, given: object) -> MotionProblem:
    known = require_keys(given, name, _KEYS, ("start", "goal_pose"))
    start = known["start"]
    if isinstance(start, Sequence) and len(start) == 9:  # with both fingers
        start = start[:7]
    goals = [numbers(q, 7, f"{name}: goal_ik") for q in known.get("goal_ik") or ()]
    return MotionProblem(
        name=name,
        q_start=np.array(numbers(start, 7, f"{name}: start")),
        X_WGoal=_goal(known["goal_pose"], name),
        q_goals=np.reshape(np.array(goals, dtype=float), (-1, 7)),
        solids=_solids(known.get("obstacles") or {}, f"{name}: obstacles"),
        held={
            solid: Primitive(p.kind, p.size, invert_pose(X_HG) @ p.X_OP)
            for solid, p in _solids(known.get("attached") or {}, f"{name}: attached").items()
        },
    )


def _goal(given: object, name: str) -> Array:
    where = f"{name}: goal_pose"
    keys = ("frame", "position_xyz", "quaternion_wxyz")
    known = require_keys(given, where, keys, keys)
    if known["frame"] != FRAME:
        raise BadInputError(f"{where} is of frame {known['frame']!r}; expected {FRAME!r}")
    listed = [
        *numbers(known["position_xyz"], 3, where),
        *numbers(known["quaternion_wxyz"], 4, where),
    ]
    return _pose(listed, where) @ X_HG


def _solids(given: object, where: str) -> dict[str, Primitive]:
    by_kind = require_keys(given, where, _KINDS)
    found: dict[str, Primitive] = {}
    for kind in _KINDS:
        entries = by_kind.get(kind) or {}
        if not isinstance(entries, Mapping):
            raise BadInputError(f"{where} has a {kind} {entries!r:.60}; expected names of solids")
        for name, entry in entries.items():
            if name in found:
                raise BadInputError(f"{where} has two solids called {name!r}")
            found[name] = _solid(kind, entry, f"{where}: {name}")
    return found


def _solid(kind: str, given: object, where: str) -> Primitive:
    if kind == "cuboid":
        known = require_keys(given, where, ("dims", "pose"), ("dims", "pose"))
        x, y, z = numbers(known["dims"], 3, f"{where}: dims")
        size: tuple[float, ...] = (x, y, z)
    else:
        keys = ("radius", "height", "pose")
        known = require_keys(given, where, keys, keys)
        size = tuple(numbers(known[key], 1, f"{where}: {key}")[0] for key in keys[:2])
    if min(size) <= 0.0:
        raise BadInputError(f"{where} measures {list(size)} m; expected lengths above 0")
    pose = _pose(numbers(known["pose"], 7, f"{where}: pose"), where)
    return Primitive("box" if kind == "cuboid" else "cylinder", size, pose)


def _pose(listed: Sequence[float], where: str) -> Array:
    """Return the pose (4, 4) of (x, y, z, qw, qx, qy, qz)."""
    quaternion = np.array(listed[3:])
    if not 0.99 < np.linalg.norm(quaternion) < 1.01:
        raise BadInputError(f"{where} has the quaternion {list(quaternion)}; expected length 1")
    return make_pose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), listed[:3])


def _fields(problem: MotionProblem) -> Fields:
    X_WH = problem.X_WGoal @ invert_pose(X_HG)
    listed = _listed(X_WH)
    fields: dict[str, Any] = {
        "start": problem.q_start.tolist(),
        "goal_pose": {
            "frame": FRAME,
            "position_xyz": listed[:3],
            "quaternion_wxyz": listed[3:],
        },
        "goal_ik": problem.q_goals.tolist(),
        "obstacles": _solid_fields(problem.solids, np.eye(4)),
        "collision_buffer_ik": 0.0,
        "world_frame": WORLD_FRAME,
    }
    if problem.held:
        fields["attached"] = _solid_fields(problem.held, X_HG)
    return fields


def _solid_fields(solids: Mapping[str, Primitive], X_FP: Array) -> Fields:
    """Return solids by kind, their poses, which are in P, given in F."""
    by_kind: dict[str, dict[str, Any]] = {kind: {} for kind in _KINDS}
    for name, solid in solids.items():
        size = [float(length) for length in solid.size]
        pose = _listed(X_FP @ solid.X_OP)
        if solid.kind == "box":
            by_kind["cuboid"][name] = {"dims": size, "pose": pose}
        else:
            by_kind["cylinder"][name] = {"radius": size[0], "height": size[1], "pose": pose}
    return by_kind


def _listed(X: Array) -> list[float]:
    """Return (x, y, z, qw, qx, qy, qz) of a pose (4, 4)."""
    quaternion = Rotation.from_matrix(X[:3, :3]).as_quat(scalar_first=True)
    return [float(value) for value in (*X[:3, 3], *quaternion)]
