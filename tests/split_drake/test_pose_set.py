"""Pose sets and their files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from split_drake.bad_input import BadInputError
from split_drake.files import UnreadableFileError, read_npz
from split_drake.pose_set import (
    Acceptance,
    PoseSet,
    ScoredPoses,
    accepted_poses,
    load_pose_sets,
    merged_pose_sets,
    save_pose_sets,
)
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask, Symmetry
from split_drake.poses import make_pose, rotation_z
from tests.helpers.damage import times_told


def poses(count: int) -> np.ndarray:
    return make_pose(p=np.arange(3.0 * count).reshape(count, 3))


def test_ranked_sorts_best_first_and_keeps_ties_in_order() -> None:
    ranked = PoseSet.ranked(GRASP, poses(4), np.array([0.5, 0.9, 0.5, 1.0]))
    np.testing.assert_array_equal(ranked.scores, [1.0, 0.9, 0.5, 0.5])
    np.testing.assert_array_equal(ranked.X_WPs[:, 0, 3], [9.0, 3.0, 0.0, 6.0])


def test_head_takes_the_best() -> None:
    pose_set = PoseSet.ranked(HANDLE, poses(3), np.array([0.1, 0.2, 0.3]))
    assert len(pose_set.head(2)) == 2
    assert pose_set.head(2).scores.min() == 0.2
    assert len(pose_set.head(9)) == 3


@pytest.mark.parametrize(
    ("X_WPs", "scores", "message"),
    [
        (poses(2), [0.5], "shape"),
        (poses(2), [0.5, 1.5], r"\[0, 1\]"),
        (poses(2), [0.5, np.nan], r"\[0, 1\]"),
        (poses(2), [0.1, 0.5], "descend"),
        (2.0 * poses(1), [0.5], "X_WPs"),
    ],
)
def test_bad_sets_are_refused(X_WPs: np.ndarray, scores: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PoseSet(GRASP, X_WPs, np.array(scores))


def test_an_empty_set_is_a_set() -> None:
    assert len(PoseSet(GRASP, np.zeros((0, 4, 4)), np.zeros(0))) == 0


def test_saved_sets_come_back(tmp_path: Path) -> None:
    sets = {
        "grasp": PoseSet(GRASP, poses(3), np.array([0.9, 0.8, 0.7])),
        "upright": PoseSet(UPRIGHT, np.zeros((0, 4, 4)), np.zeros(0)),
    }
    cloud = np.random.default_rng(0).normal(size=(10, 3))
    path = tmp_path / "new folder" / "poses.npz"
    save_pose_sets(path, sets, cloud)
    loaded, loaded_cloud = load_pose_sets(path)
    assert set(loaded) == set(sets)
    np.testing.assert_array_equal(loaded["grasp"].X_WPs, poses(3))
    np.testing.assert_allclose(loaded_cloud, cloud, atol=1e-6)
    assert [file.name for file in path.parent.iterdir()] == ["poses.npz"]


def test_saved_sets_keep_their_tasks(tmp_path: Path) -> None:
    spout = PoseTask("spout", Symmetry.any_turn("x"), "where tea comes out, along x")
    save_pose_sets(
        tmp_path / "poses.npz", {"spout": PoseSet(spout, poses(1), np.ones(1))}, poses(2)[:, :3, 3]
    )
    loaded, _ = load_pose_sets(tmp_path / "poses.npz")
    assert loaded["spout"].task == spout


def test_archives_that_do_not_name_their_tasks_hold_those_of_mugs(tmp_path: Path) -> None:
    arrays = {"cloud": np.zeros((1, 3)), "handle/X_WPs": poses(2), "handle/scores": np.ones(2)}
    np.savez(tmp_path / "poses.npz", allow_pickle=False, **arrays)
    loaded, _ = load_pose_sets(tmp_path / "poses.npz")
    assert {name: found.task for name, found in loaded.items()} == {"handle": HANDLE}


LID = PoseTask("lid")
POINTS = np.zeros((1, 3))


def test_sets_come_back_by_the_names_of_their_tasks(tmp_path: Path) -> None:
    path = tmp_path / "poses.npz"
    save_pose_sets(path, {"lids": PoseSet(LID, poses(2), np.ones(2))}, POINTS)
    loaded, _ = load_pose_sets(path)
    assert list(loaded) == ["lid"]
    np.testing.assert_array_equal(loaded["lid"].X_WPs, poses(2))


def test_two_sets_of_one_name_are_not_saved(tmp_path: Path) -> None:
    one, other = PoseSet(LID, poses(2), np.ones(2)), PoseSet(LID, poses(1), np.ones(1))
    with pytest.raises(ValueError, match="of the tasks lid, lid; expected one of each"):
        save_pose_sets(tmp_path / "poses.npz", {"one": one, "other": other}, POINTS)
    assert not (tmp_path / "poses.npz").exists()


@pytest.mark.parametrize("lost", ["X_WPs", "scores"])
def test_an_archive_without_poses_of_a_task_that_it_lists_is_refused(
    tmp_path: Path, lost: str
) -> None:
    path = tmp_path / "poses.npz"
    save_pose_sets(path, {"lid": PoseSet(LID, poses(2), np.ones(2))}, POINTS)
    with np.load(path) as archive:
        kept = {name: archive[name] for name in archive.files if name != f"lid/{lost}"}
    np.savez(path, allow_pickle=False, **kept)
    with pytest.raises(ValueError, match=f"poses.npz lists the task lid, but has no lid/{lost}$"):
        load_pose_sets(path)


def test_scores_that_reach_the_threshold_are_accepted() -> None:
    drawn = {
        "grasp": ScoredPoses(poses(3), np.array([0.4, 0.2, 0.9])),
        "upright": ScoredPoses(poses(1), np.array([0.1])),
        "handle": ScoredPoses(poses(1), np.array([1.0])),
    }
    found = accepted_poses(drawn, (GRASP, UPRIGHT), Acceptance(0.4, 0.4))
    assert list(found) == ["grasp", "upright"]
    assert found["grasp"].task == GRASP
    np.testing.assert_array_equal(found["grasp"].scores, [0.9, 0.4])
    np.testing.assert_array_equal(found["grasp"].X_WPs[:, 0, 3], [6.0, 0.0])
    assert len(found["upright"]) == 0


def test_where_scores_are_low_those_near_the_best_are_accepted() -> None:
    acceptance = Acceptance(least=0.4, enough=0.6, of_best=0.9)
    for scores, accepted in (
        ([0.9, 0.61, 0.59, 0.3], [True, True, False, False]),
        ([0.5, 0.46, 0.44, 0.3], [True, True, False, False]),
        ([0.42, 0.41, 0.39, 0.3], [True, True, False, False]),
        ([0.39, 0.2], [False, False]),
        ([], []),
    ):
        np.testing.assert_array_equal(acceptance.accepted(np.array(scores)), accepted)


@pytest.mark.parametrize(
    "numbers", [(-0.1, 0.5, 0.9), (0.5, 0.4, 0.9), (0.5, 1.0, 0.9), (0.1, 0.2, 1.1)]
)
def test_impossible_bounds_of_scores_are_refused(numbers: tuple[float, float, float]) -> None:
    with pytest.raises(BadInputError, match="no less enough than least"):
        Acceptance(*numbers)
    with pytest.raises(BadInputError, match="enough is nan"):
        Acceptance(0.1, float("nan"))


def test_sets_of_parts_are_merged_best_first() -> None:
    first = {"grasp": PoseSet(GRASP, poses(2), np.array([0.9, 0.2]))}
    second = {"grasp": PoseSet(GRASP, poses(1), np.array([0.5]))}
    assert merged_pose_sets([first, second])["grasp"].scores.tolist() == [0.9, 0.5, 0.2]
    assert merged_pose_sets([first]).keys() == {"grasp"}
    for parts in ([], [first, {}]):
        with pytest.raises(ValueError, match="expected the same in each"):
            merged_pose_sets(parts)


def test_what_is_accepted_is_rounded() -> None:
    X_WPs = make_pose(rotation_z(0.3), (0.123456, 0.2, -0.1))[None]
    drawn = {"grasp": ScoredPoses(X_WPs + 3e-7, np.array([0.7891234]))}
    again = {"grasp": ScoredPoses(X_WPs - 3e-7, np.array([0.7891239]))}
    found, same = (
        accepted_poses(d, (GRASP,), Acceptance(0.4, 0.4))["grasp"] for d in (drawn, again)
    )
    np.testing.assert_array_equal(found.X_WPs, same.X_WPs)
    np.testing.assert_array_equal(found.X_WPs[0, :3, 3], [0.1235, 0.2, -0.1])
    assert found.scores.tolist() == same.scores.tolist() == [0.789]


def test_a_foreign_archive_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", weights=np.zeros(3))
    with pytest.raises(ValueError, match="weights"):
        load_pose_sets(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"cloud": np.zeros(3)}, r"cloud has shape \(3,\) and type float64; expected \(N, 3\)"),
        ({"cloud": np.zeros((4, 2))}, r"cloud has shape \(4, 2\)"),
        ({"cloud": np.array([["a", "b", "c"]])}, "cloud has shape .* and type <U1; expected"),
        ({"cloud": np.full((1, 3), np.nan)}, "cloud holds NaN or infinite values"),
        ({"lid/X_WPs": np.zeros(32)}, r"lid/X_WPs has shape \(32,\); expected \(N, 4, 4\)"),
        ({"lid/X_WPs": np.zeros((2, 4, 4))}, "X_WPs of lid has a last row other than"),
        ({"lid/scores": np.ones(3)}, r"scores have shape \(3,\); expected \(2,\)"),
        ({"tasks": np.array("[{]")}, "is damaged or not a file of pose sets"),
        ({"tasks": np.array('[{"name": "lid"}]')}, "'symmetry' is missing"),
    ],
)
def test_what_is_no_pose_set_is_told_with_the_path(
    tmp_path: Path, changed: dict[str, np.ndarray], message: str
) -> None:
    path = tmp_path / "poses.npz"
    save_pose_sets(path, {"lid": PoseSet(LID, poses(2), np.ones(2))}, POINTS)
    np.savez(path, allow_pickle=False, **{**read_npz(path, "poses"), **changed})
    with pytest.raises(UnreadableFileError, match=message) as caught:
        load_pose_sets(path)
    assert str(caught.value).startswith(str(path))


def test_all_damage_is_told(tmp_path: Path) -> None:
    path = tmp_path / "poses.npz"
    save_pose_sets(path, {"lid": PoseSet(LID, poses(2), np.ones(2))}, POINTS)
    assert times_told(path, load_pose_sets) > 50


def test_a_cloud_that_could_not_be_loaded_is_not_saved(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"cloud has shape \(3, 4\)"):
        save_pose_sets(tmp_path / "poses.npz", {}, np.zeros((3, 4)))
    assert not (tmp_path / "poses.npz").exists()


@pytest.mark.parametrize("scores", [np.ones(3), np.ones(7), np.ones((6, 1)), np.float64(1.0)])
def test_poses_are_ranked_by_a_score_each(scores: np.ndarray) -> None:
    with pytest.raises(BadInputError, match=r"6 poses of lid have scores .*expected \(6,\)"):
        PoseSet.ranked(LID, poses(6), scores)


def test_numbers_are_not_taken_for_poses() -> None:
    with pytest.raises(ValueError, match=r"X_WPs of lid has shape \(2, 16\)"):
        PoseSet(LID, np.zeros((2, 16)), np.ones(2))


def test_parts_of_a_set_are_asked_for_in_numbers_that_it_has() -> None:
    found = PoseSet(LID, poses(3), np.ones(3))
    with pytest.raises(BadInputError, match="count is -1; expected how many poses"):
        found.head(-1)
    for kept in (np.array([True]), np.array([0, 2, 1]), np.ones((3, 1), bool)):
        with pytest.raises(BadInputError, match=r"expected \(3,\) booleans, one for each pose"):
            found.subset(kept)
    assert len(found.subset(np.array([True, False, True]))) == 2


def test_an_empty_set_says_why(tmp_path: Path) -> None:
    drawn = {GRASP.name: ScoredPoses(np.stack([np.eye(4)] * 3), np.array([0.1, 0.3, 0.2]))}
    nothing = accepted_poses(drawn, [GRASP], Acceptance(0.4, 0.9))[GRASP.name]
    assert nothing.reason == (
        "none of 3 poses drawn was accepted: the best has a score of 0.300, the least that is "
        "accepted is 0.4"
    )
    save_pose_sets(str(tmp_path / "poses.npz"), {GRASP.name: nothing}, np.zeros((1, 3)))
    assert load_pose_sets(tmp_path / "poses.npz")[0][GRASP.name].reason == nothing.reason
    some = accepted_poses(drawn, [GRASP], Acceptance(0.25, 0.25))[GRASP.name]
    assert (len(some), some.reason) == (1, "")
    merged = merged_pose_sets([{GRASP.name: nothing}, {GRASP.name: nothing}])[GRASP.name]
    assert merged.reason == nothing.reason
    assert not merged_pose_sets([{GRASP.name: nothing}, {GRASP.name: some}])[GRASP.name].reason
    with pytest.raises(ValueError, match="1 poses of grasp have a reason why there are none: lost"):
        replace(some, reason="lost")
