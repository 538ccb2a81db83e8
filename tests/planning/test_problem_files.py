"""Problems come back from disk nearly as they were, and damaged files are refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planning.geometry.perceived import DETAIL_VOXEL_M, voxel_centroids
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.problem import PlanningProblem
from planning.problem_files import _checksum, compact, load_problems, save_problems
from split_drake.files import MissingFileError, UnreadableFileError, read_npz
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask, Symmetry
from split_drake.station.layout import HookShape, Layout, same_fixtures
from split_drake.station.layout_file import layout_from_json, layout_to_json
from tests.helpers.damage import times_told
from tests.helpers.planning import LYING, STANDING, mug_problem

Midway = Callable[[PlanningProblem], PlanningProblem]


def problems() -> dict[str, PlanningProblem]:
    hang = mug_problem(HANG, STANDING)
    lying = mug_problem(REORIENT, LYING)
    no_grasp = PoseSet(GRASP, np.empty((0, 4, 4)), np.empty(0))
    sets = {"grasp": no_grasp, "upright": lying.pose_sets["upright"]}
    elsewhere = Layout(hook=HookShape(peg_radius_m=0.008), p_WTable=(0.5, 0.0))
    return {
        "hang": hang,
        "lying": replace(lying, pose_sets=sets),
        "other station": replace(hang, layout=elsewhere),
    }


def test_problems_come_back_within_the_quantisation(tmp_path: Path) -> None:
    save_problems(tmp_path / "p.npz", problems())
    loaded = load_problems(tmp_path / "p.npz")
    assert list(loaded) == list(problems())
    for name, before in problems().items():
        after = loaded[name]
        assert after.subgoal == before.subgoal
        np.testing.assert_array_equal(after.q_start, before.q_start)
        np.testing.assert_allclose(after.p_WPs, before.p_WPs, atol=0.51e-4)
        assert same_fixtures(after.layout, before.layout)
        assert after.pose_sets.keys() == before.pose_sets.keys()
        for task, poses in before.pose_sets.items():
            np.testing.assert_allclose(after.pose_sets[task].X_WPs, poses.X_WPs, atol=2e-4)
            np.testing.assert_allclose(after.pose_sets[task].scores, poses.scores, atol=1e-5)


def test_an_empty_collection_comes_back(tmp_path: Path) -> None:
    save_problems(tmp_path / "p.npz", {})
    assert load_problems(tmp_path / "p.npz") == {}


def test_a_layout_comes_back_from_json() -> None:
    layout = problems()["other station"].layout
    again = layout_from_json(layout_to_json(layout))
    assert again.hook == layout.hook
    assert again.workspace == layout.workspace
    np.testing.assert_array_equal(again.X_WK, layout.X_WK)


def test_compact_problems_keep_the_best_poses_and_the_planners_voxels() -> None:
    problem = mug_problem(HANG, STANDING)
    small = compact(problem, {"grasp": 5}, otherwise=1)
    assert [len(poses) for poses in small.pose_sets.values()] == [5, 1, 1]
    assert len(small.p_WPs) < len(problem.p_WPs)
    np.testing.assert_allclose(voxel_centroids(small.p_WPs, DETAIL_VOXEL_M), small.p_WPs)


def test_tasks_come_back_with_their_meaning(tmp_path: Path) -> None:
    lid = PoseTask("lid", Symmetry.any_turn("z"), "a lid: z away from what it closes")
    known = problems()["hang"]
    found = {**known.pose_sets, "lid": PoseSet(lid, np.eye(4)[None], np.ones(1))}
    save_problems(tmp_path / "p.npz", {"pot": replace(known, pose_sets=found)})
    after = load_problems(tmp_path / "p.npz")["pot"].pose_sets
    assert {name: poses.task for name, poses in after.items()} == {
        name: poses.task for name, poses in found.items()
    }


def test_two_tasks_of_one_name_are_refused(tmp_path: Path) -> None:
    known = problems()["hang"]
    other = PoseSet(replace(GRASP, symmetry=Symmetry()), np.eye(4)[None], np.ones(1))
    mixed = {"one": known, "two": replace(known, pose_sets={**known.pose_sets, "grasp": other})}
    with pytest.raises(ValueError, match="two tasks are called 'grasp'"):
        save_problems(tmp_path / "p.npz", mixed)


def test_points_beyond_the_format_are_errors(tmp_path: Path) -> None:
    problem = mug_problem(HANG, STANDING)
    far = replace(problem, p_WPs=problem.p_WPs + 4.0)
    with pytest.raises(ValueError, match=r"expected at most 3\.28"):
        save_problems(tmp_path / "p.npz", {"far": far})


@pytest.mark.parametrize(
    "go_on",
    [
        lambda problem: replace(problem, held_width_m=0.005),
        lambda problem: replace(problem, X_WGfailed=np.eye(4)[None]),
    ],
    ids=["held", "failed"],
)
def test_problems_in_the_midst_of_a_task_are_refused(go_on: Midway, tmp_path: Path) -> None:
    problem = go_on(problems()["hang"])
    with pytest.raises(ValueError, match="'hang' has an object in the hand or grasps"):
        save_problems(tmp_path / "p.npz", {"hang": problem})
    assert not (tmp_path / "p.npz").exists()


def test_a_file_with_another_content_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.npz"
    save_problems(path, problems())
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    moved = arrays["cloud"].copy()
    moved[0, 0] += 1
    np.savez_compressed(path, **{**arrays, "cloud": moved})
    with pytest.raises(ValueError, match="damaged"):
        load_problems(path)
    np.savez_compressed(path, **{**arrays, "format": np.array(99)})
    with pytest.raises(ValueError, match="format 99; expected 3"):
        load_problems(path)


def test_all_damage_is_told_with_the_path(tmp_path: Path) -> None:
    save_problems(tmp_path / "p.npz", problems())
    assert times_told(tmp_path / "p.npz", load_problems) > 50
    with pytest.raises(MissingFileError, match=r"no file no.npz; expected a file of planning"):
        load_problems("no.npz")


def test_content_without_meaning_is_told_with_the_path(tmp_path: Path) -> None:
    path = tmp_path / "p.npz"
    save_problems(path, problems())
    arrays = read_npz(path, "problems")
    for name, value in (("subgoals", np.array(["fly"] * 3)), ("cloud_counts", np.zeros(3, int))):
        changed = {**arrays, name: value}
        del changed["sha256"], changed["format"]
        sha256 = np.array(_checksum(changed))
        changed |= {"format": np.array(3), "sha256": sha256}
        np.savez_compressed(path, allow_pickle=False, **changed)
        with pytest.raises(UnreadableFileError, match=f"^{path} is damaged|{path}.*fly"):
            load_problems(path)


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.99])
def test_a_file_cut_short_is_refused(tmp_path: Path, kept: float) -> None:
    path = tmp_path / "p.npz"
    save_problems(path, problems())
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(ValueError, match=r"p.npz is damaged or not a file of planning"):
        load_problems(path)
