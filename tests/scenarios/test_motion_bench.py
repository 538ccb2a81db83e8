"""Free motions among boxes and cylinders: their files, planners on them, and what is exported."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from planning.goals.hang import SUBGOAL as HANG
from planning.motion.free import free_motion, rrt_motion
from planning.problem_files import SHIPPED_PROBLEMS, load_problems
from scenarios.bench.motions.export import cubes, exported
from scenarios.bench.motions.problem import MotionProblem
from scenarios.bench.motions.robometrics_file import (
    X_HG,
    read_motion_problems,
    write_motion_problems,
)
from scenarios.bench.motions.run import HELD_STEP_M, MotionTask, motion_of, surface_points
from scenarios.bench.plan_measures import measure_motion
from scenarios.planner_bench import BenchOptions, main
from split_drake.bad_input import BadInputError
from split_drake.files import UnreadableFileError
from split_drake.objects.rigid import Primitive
from split_drake.poses import make_pose, rotation_z
from split_drake.robot.kinematics import gripper_pose
from tests.helpers.planning import configuration

Q_START, Q_GOAL = configuration((0.5, -0.2, 0.2)), configuration((0.5, 0.2, 0.2))
# A board between both, across the straight way of the hand.
BOARD = Primitive("box", (0.3, 0.02, 0.3), make_pose(rotation_z(0.1), (0.5, 0.0, 0.15)))
CAN = Primitive("cylinder", (0.03, 0.1), make_pose(p=(0.0, 0.0, 0.03)))
PROBLEM = MotionProblem("set-0", Q_START, gripper_pose(Q_GOAL), solids={"board": BOARD})
IN_ROBOMETRICS = """
bookshelf:
- start: [0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785, 0.04, 0.04]
  goal_pose:
    frame: panda_hand
    position_xyz: [0.5, 0.1, 0.4]
    quaternion_wxyz: [0.0, 1.0, 0.0, 0.0]
  obstacles:
    cuboid: {shelf: {dims: [0.4, 0.8, 0.02], pose: [0.6, 0.0, 0.2, 1, 0, 0, 0]}}
    cylinder: {can: {radius: 0.03, height: 0.1, pose: [0.6, 0.1, 0.27, 1, 0, 0, 0]}}
  collision_buffer_ik: 0.0
  world_frame: panda_link0
"""


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_problems_are_read_in_robometrics_keys(tmp_path: Path) -> None:
    path = tmp_path / "problems.yaml"
    path.write_text(IN_ROBOMETRICS)
    ((name, problem),) = read_motion_problems(path).items()
    assert name == "bookshelf-0" and len(problem.q_goals) == 0
    np.testing.assert_allclose(problem.q_start, [0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785])
    # The hand points down: its pads are below its frame.
    np.testing.assert_allclose(problem.X_WGoal[:3, 3], [0.5, 0.1, 0.4 - X_HG[2, 3]])
    assert problem.solids["shelf"].size == (0.4, 0.8, 0.02)
    assert problem.solids["can"].kind == "cylinder" and problem.solids["can"].size == (0.03, 0.1)
    np.testing.assert_allclose(problem.solids["can"].X_OP[:3, 3], [0.6, 0.1, 0.27])


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    path, full = (
        tmp_path / "motions.yaml",
        replace(PROBLEM, q_goals=Q_GOAL[None], held={"can": CAN}),
    )
    write_motion_problems(path, {"set": [full, PROBLEM]})
    read = read_motion_problems(path)
    assert list(read) == ["set-0", "set-1"]
    for wanted, found in zip((full, PROBLEM), read.values(), strict=True):
        np.testing.assert_allclose(found.X_WGoal, wanted.X_WGoal, atol=1e-9)
        np.testing.assert_allclose(found.q_goals, wanted.q_goals)
        for wanted_solids, solids in ((wanted.solids, found.solids), (wanted.held, found.held)):
            assert wanted_solids.keys() == solids.keys()
            for name, solid in solids.items():
                assert (solid.kind, solid.size) == (
                    wanted_solids[name].kind,
                    wanted_solids[name].size,
                )
                np.testing.assert_allclose(solid.X_OP, wanted_solids[name].X_OP, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cylinder:", "mesh:", "obstacles has 'mesh'; expected cuboid, cylinder"),
        ("panda_hand", "tool0", "of frame 'tool0'; expected 'panda_hand'"),
        ("[0.0, 1.0, 0.0, 0.0]", "[0.0, 2.0, 0.0, 0.0]", "expected length 1"),
        ("radius: 0.03", "radius: -0.03", r"measures \[-0.03, 0.1\] m; expected lengths above 0"),
        ("start:", "begin:", "has 'begin'; expected start"),
        ("0.785, 0.04, 0.04]", "0.785, 0.04]", "start is .*; expected 7 numbers"),
        ("can: {", "shelf: {", "two solids called 'shelf'"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "problems.yaml"
    assert old in IN_ROBOMETRICS
    path.write_text(IN_ROBOMETRICS.replace(old, new))
    with pytest.raises((BadInputError, UnreadableFileError), match=message):
        read_motion_problems(path)


def test_a_motion_leads_around_what_stands_in_the_way() -> None:
    straight = MotionTask.of(replace(PROBLEM, solids={})).plan(free_motion, rng())
    assert not isinstance(straight, str)
    task = MotionTask.of(PROBLEM)
    assert task.fault(straight) == "it touches something"
    around = task.plan(free_motion, rng())
    assert not isinstance(around, str)
    assert task.fault(around) == ""
    measures = measure_motion(task.world.checker, around, task.situation.opening_m)
    assert measures.path_length_rad > 1.05 * np.linalg.norm(straight.qs[-1] - Q_START)
    assert 0.0 < measures.clearance_m < 0.1 and measures.duration_s > 0.5


def test_what_is_held_keeps_clear_as_well() -> None:
    """A rod in the hand reaches the wall that the hand itself stays 3 cm away from."""
    X_WG = gripper_pose(Q_GOAL)
    wall = Primitive("box", (0.3, 0.3, 0.02), X_WG @ make_pose(p=(0.0, 0.0, 0.05)))
    rod = Primitive("cylinder", (0.005, 0.1), make_pose())
    bare = replace(PROBLEM, solids={"wall": wall}, q_goals=Q_GOAL[None])
    assert not isinstance(MotionTask.of(bare).plan(free_motion, rng()), str)
    found = MotionTask.of(replace(bare, held={"rod": rod})).plan(free_motion, rng())
    assert found == "no configuration that reaches the goal is free"


def test_a_start_that_touches_something_is_said() -> None:
    X_WG = gripper_pose(Q_START)
    inside = replace(PROBLEM, solids={"block": Primitive("box", (0.1, 0.1, 0.1), X_WG)})
    assert MotionTask.of(inside).plan(free_motion, rng()) == "the start touches something"


def test_points_lie_on_the_surface_no_further_apart_than_said() -> None:
    for solid in (CAN, Primitive("box", (0.05, 0.03, 0.1), make_pose(rotation_z(0.3)))):
        points = surface_points(solid) - solid.X_OP[:3, 3]
        points = points @ solid.X_OP[:3, :3]
        if solid.kind == "box":
            assert np.abs(np.abs(points) / np.array(solid.size) * 2.0).max() <= 1.0 + 1e-9
            on = np.isclose(np.abs(points), np.array(solid.size) / 2.0).any(axis=1)
        else:
            radius, length = np.hypot(points[:, 0], points[:, 1]), np.abs(points[:, 2])
            on = np.isclose(radius, solid.size[0]) | np.isclose(length, solid.size[1] / 2.0)
        assert on.all()
        gaps = np.linalg.norm(points[:, None] - points, axis=-1)
        np.fill_diagonal(gaps, np.inf)
        assert gaps.min(axis=1).max() <= HELD_STEP_M + 1e-9


def test_planners_have_the_motions_that_they_are_named_for() -> None:
    assert motion_of("rrt") is rrt_motion and motion_of("default") is free_motion


def test_cubes_hold_all_points() -> None:
    points = rng().normal(scale=0.04, size=(500, 3))
    found = cubes(points, "object")
    middles = np.stack([cube.X_OP[:3, 3] for cube in found.values()])
    assert np.abs(points[:, None] - middles).max(axis=-1).min(axis=1).max() <= 0.01 + 1e-9


def test_shipped_problems_are_exported_as_motions_that_planners_find(tmp_path: Path) -> None:
    name, problem = next(
        (n, p) for n, p in load_problems(SHIPPED_PROBLEMS).items() if p.subgoal == HANG
    )
    motions, unsolved = exported({name: problem}, seed=0)
    assert unsolved == 0
    ((transit,), (transfer,)) = motions.values()
    assert not transit.held and transfer.held
    assert any(key.startswith("object") for key in transit.solids)
    assert not any(key.startswith("object") for key in transfer.solids)
    assert {"table_0", "hook_0", "hook_1"} <= transit.solids.keys()
    for motion in (transit, transfer):
        task = MotionTask.of(motion)
        found = task.plan(free_motion, rng())
        assert not isinstance(found, str)
        assert task.fault(found) == ""


def test_a_file_of_motions_is_benched_and_gone_on_with(tmp_path: Path) -> None:
    path, out = tmp_path / "motions.yaml", tmp_path / "bench"
    away = replace(PROBLEM, X_WGoal=make_pose(p=(2.0, 0.0, 0.5)))
    write_motion_problems(path, {"set": [PROBLEM, away]})
    options = BenchOptions(planner=("default", "gcs"), problems=path, out=out)
    main(options)
    results = [yaml.safe_load(line) for line in (out / "results.jsonl").read_text().splitlines()]
    outcomes = {(r["problem"], r["planner"]): (r["outcome"], r["reason"]) for r in results}
    assert outcomes["set-0", "default"] == ("solved", "")
    assert outcomes["set-0", "gcs"] == ("planning", "the GCS regions are of another station")
    assert "reaches the goal" in outcomes["set-1", "default"][1]
    summary = yaml.safe_load((out / "summary.json").read_text())
    assert summary["planners"]["default"]["groups"]["motion-set"]["successes"] == 1
    main(options)
    assert len((out / "results.jsonl").read_text().splitlines()) == 4


def test_motions_are_not_exported_again(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds motions already"):
        BenchOptions(problems=tmp_path / "motions.yaml", export=tmp_path / "more.yaml")


def test_the_command_exports(tmp_path: Path) -> None:
    path = tmp_path / "motions.yaml"
    assert main(BenchOptions(limit=1, export=path)) == path
    assert {name.rsplit("-", 1)[0] for name in read_motion_problems(path)} == {
        "transit",
        "transfer",
    }
