"""What the READMEs show runs as it stands."""

import re
import runpy
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, redirect_stdout
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from planning.checking.goal_checks import goal_check
from planning.checking.plan_contract import contract_violations
from planning.plan_rows import import_rows
from planning.planner import make_planner
from planning.problem import Plan, rows_of
from planning.subgoal import find_subgoal
from split_drake.data.dataset import SceneDataset
from split_drake.data.render import DepthRenderer
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseSet, load_pose_sets
from split_drake.poses import Array, make_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout, OpenBin
from tests.helpers.clutter import box_cloud, grasp_from_above, grasps
from tests.helpers.planning import LYING, STANDING, mug_problem, reorient_plan
from tests.helpers.rooms import added_files

ROOT = Path(__file__).parents[2]
READMES = (
    "README.md",
    "planning/README.md",
    "scenarios/README.md",
    "split_drake/README.md",
    "split_drake/experiments/cluster/README.md",
)
SUBCOMMANDS = ("judge", "judge-clutter", "tune", "train")
COMMAND = re.compile(r"python -m ((?:scenarios|split_drake|models)(?:\.\w+)+)([^\n`|#]*)")


def examples(name: str) -> list[str]:
    """Return the blocks of Python in a README, in their order."""
    return re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(), flags=re.DOTALL)


def executed(code: str, **names: Any) -> dict[str, Any]:
    """Return what a block of Python defines."""
    defined = {**names, "__name__": "example"}
    exec(code, defined)
    return defined


def test_the_planner_is_the_one_that_is_tested() -> None:
    assert examples("planning/README.md")[0] == (ROOT / "tests/helpers/one_bend.py").read_text()


def test_the_examples_find_poses_and_make_a_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    camera = Layout().cameras[1]
    renderer = DepthRenderer(load_mug("test_004").body.mesh)
    view = renderer.render(make_pose(p=(0.5, 0.0, 0.0)), camera)
    defined = executed(examples("README.md")[0], depth_m=view.depth_m, X_WC=camera.X_WC)
    assert isinstance(defined["grasps"], PoseSet)
    assert len(defined["grasps"]) > 0
    found, _ = load_pose_sets(tmp_path / "runs/poses.npz")
    assert set(found) == {"grasp", "handle", "upright"}
    planned = executed(examples("README.md")[1], **defined)
    assert isinstance(planned["plan"], Plan), planned["plan"].reason
    assert import_rows(tmp_path / "runs/plan.json") == rows_of(planned["plan"].segments)


@pytest.fixture
def _set_down(tmp_path: Path) -> Iterator[None]:
    """Have the README's subgoal and its check lie where it says."""
    text = (ROOT / "planning/README.md").read_text()
    _, subgoal, check, *_ = examples("planning/README.md")
    with ExitStack() as stack:
        for room, code in (("goals", subgoal), ("checking/goals", check)):
            assert f"`planning/{room}/set_down.py`" in text
            folder = tmp_path / room
            folder.mkdir(parents=True)
            name = f"planning.{room.replace('/', '.')}"
            stack.enter_context(added_files(folder, name, {"set_down": code}))
        yield


@pytest.mark.usefixtures("_set_down")
@pytest.mark.parametrize("X_WO", [STANDING, LYING], ids=["standing", "lying"])
def test_the_subgoal_is_planned_for_and_checked_where_it_says(X_WO: Array) -> None:
    problem = mug_problem(find_subgoal("set_down"), X_WO)
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    assert contract_violations(plan, problem) == []
    # 0.1 m to the left, and upright.
    p_WCenter = np.array(problem.layout.workspace.p_WCenter)
    np.testing.assert_allclose((plan.X_WGoal[:3, 3] - p_WCenter)[:2], (0.0, 0.1), atol=1e-9)
    assert plan.X_WGoal[2, 2] == pytest.approx(1.0)
    off = replace(plan, X_WGoal=make_pose(p=(0.02, 0.0, 0.0)) @ plan.X_WGoal)
    assert "mm from its place" in goal_check("set_down").off_goal(off, problem)


def test_the_table_is_cleared_as_shown() -> None:
    scene = SimpleNamespace(p_WPs=box_cloud((0.5, 0.0), (0.04, 0.04, 0.06)))
    defined = executed(
        examples("planning/README.md")[3],
        pose_sets={"grasp": grasps(grasp_from_above((0.5, 0.0, 0.045)))},
        scene=scene,
        q_start=Q_HOME,
        layout=replace(Layout(), bin=OpenBin()),
    )
    assert defined["segments"] == defined["outcome"].segments
    assert len(defined["segments"]) == 7


def test_an_exported_plan_is_followed_by_a_plain_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plan = reorient_plan()
    plan.export("plan.json")
    defined = executed(examples("planning/README.md")[4])
    reached = defined["plant"].GetPositions(defined["context"], defined["panda"])[:7]
    np.testing.assert_allclose(reached, plan.segments[-1].trajectory.qs[-1], atol=0.01)
    assert defined["simulator"].get_context().get_time() > 5.0


def test_objects_of_ones_own_have_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    executed(examples("split_drake/README.md")[0])
    dataset = SceneDataset.open(tmp_path / "datasets/cans")
    assert len(dataset) == 10
    assert [task.name for task in dataset.tasks] == ["grasp", "top"]


def commands() -> Iterator[tuple[str, str]]:
    """Yield the commands of all READMEs and notes: a module, and what follows it."""
    for name in (*READMES, "BUILD-notes.md"):
        yield from COMMAND.findall((ROOT / name).read_text().replace("\\\n", " "))


@cache
def flags_of(module: str, subcommand: str) -> set[str]:
    """Return the flags that a command knows; it is run in this process, which has its imports."""
    arguments, told = [module, *([subcommand] if subcommand else []), "--help"], StringIO()
    with (
        patch.object(sys, "argv", arguments),
        redirect_stdout(told),
        warnings.catch_warnings(action="ignore", category=RuntimeWarning),  # imported before
        pytest.raises(SystemExit) as ended,
    ):
        runpy.run_module(module, run_name="__main__")
    assert not ended.value.code, f"{module}: {ended.value.code}"
    return set(re.findall(r"--[a-z][\w.-]*", told.getvalue()))


def test_every_command_knows_the_flags_that_are_shown() -> None:
    shown = list(commands())
    assert len(shown) > 20
    for module, rest in shown:
        subcommand = next((word for word in rest.split()[:1] if word in SUBCOMMANDS), "")
        if module.endswith("tune_evaluator") and not subcommand:
            continue
        assert find_spec(module) is not None, f"there is no module {module}"
        wanted = set(re.findall(r"--[a-z][\w.-]*", rest))
        unknown = wanted - flags_of(module, subcommand) if wanted else set()
        assert not unknown, f"python -m {module}{rest}: unknown {unknown}"
