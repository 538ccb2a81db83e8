"""What every pose detector keeps to: the oracle and SPLIT with the weights of the project."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest

from split_drake.grasps.sampling import sample_grasps
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseDetector, PoseSet
from split_drake.pose_task import GRASP, MUG_TASKS, UPRIGHT, PoseTask, Symmetry, UnknownTaskError
from split_drake.poses import check_poses, make_pose, rotation_z
from split_drake.scene import Scene
from split_drake.split.detector import SamplerConfig, SplitDetector
from split_drake.station.station import Station
from split_drake.truth.oracle import OracleDetector
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION

# A gripper frame lies between the pads: grasps of what is in the workspace are hardly outside.
MARGIN_M = 0.03


@cache
def mug_on_table() -> tuple[Station, Scene]:
    """Return a station with an unseen mug upright on the table, and what its cameras see."""
    station = Station(STATION, [load_mug("test_001").body])
    station.place_object(0, make_pose(rotation_z(0.8), (0.51, -0.02, 0.0)))
    return station, Scene.from_views(station.capture(), station.config.layout.workspace)


def oracle() -> PoseDetector:
    """Return the oracle for the mug; fewer grasps than it has, so that chance plays a part."""
    mug = load_mug("test_001")
    labels = sample_grasps(mug.body, np.random.default_rng(0), positives=200)
    return OracleDetector(Truth(mug_on_table()[0]), mug, labels, max_grasps=50)


def split() -> PoseDetector:
    """Return SPLIT; 64 samples show as much as 256."""
    return SplitDetector.from_checkpoint(config=SamplerConfig(samples=64))


@pytest.fixture(scope="module", params=[oracle, split])
def detector(request: pytest.FixtureRequest) -> PoseDetector:
    make: Callable[[], PoseDetector] = request.param
    return make()


@pytest.fixture
def scene() -> Scene:
    return mug_on_table()[1]


def detect(
    detector: PoseDetector, scene: Scene, tasks: Sequence[PoseTask | str] = MUG_TASKS, seed: int = 0
) -> dict[str, PoseSet]:
    """Return the pose sets for a seed."""
    return detector.detect(scene, tasks, np.random.default_rng(seed))


def same(first: PoseSet, second: PoseSet) -> bool:
    """Return whether two pose sets are equal bit by bit."""
    return np.array_equal(first.X_WPs, second.X_WPs) and np.array_equal(first.scores, second.scores)


@pytest.mark.parametrize("tasks", [MUG_TASKS, MUG_TASKS[::-1], (UPRIGHT,), MUG_TASKS[:2]])
def test_there_is_one_set_for_each_task_asked_for(
    detector: PoseDetector, scene: Scene, tasks: tuple[PoseTask, ...]
) -> None:
    sets = detect(detector, scene, tasks)
    assert [*sets] == [task.name for task in tasks]
    for task in tasks:
        found = sets[task.name]
        assert found.task == task
        assert len(found) > 0, "a mug in plain view has poses for all tasks"


def test_tasks_may_be_asked_for_by_their_names(detector: PoseDetector, scene: Scene) -> None:
    named = detect(detector, scene, ("handle", UPRIGHT))
    assert [found.task.name for found in named.values()] == [*named] == ["handle", "upright"]
    meant = detect(detector, scene, MUG_TASKS[1:])
    assert all(same(named[name], meant[name]) for name in named)


@pytest.mark.parametrize("task", ["peel", PoseTask("lid")], ids=str)
def test_unknown_tasks_are_refused_and_those_known_named(
    detector: PoseDetector, scene: Scene, task: PoseTask | str
) -> None:
    with pytest.raises(UnknownTaskError, match=f"no task '{task}'.*grasp, handle, upright"):
        detect(detector, scene, (GRASP, task))


def test_a_task_of_another_symmetry_is_another_task(detector: PoseDetector, scene: Scene) -> None:
    turning = PoseTask("upright", Symmetry.any_turn("z"))
    with pytest.raises(UnknownTaskError, match=r"'any turn'.*'none'"):
        detect(detector, scene, (turning,))


def test_no_task_gives_no_set(detector: PoseDetector, scene: Scene) -> None:
    assert detect(detector, scene, ()) == {}


def test_scores_descend_from_one_at_most_to_zero_at_least(
    detector: PoseDetector, scene: Scene
) -> None:
    for found in detect(detector, scene).values():
        assert found.scores.shape == (len(found),)
        assert found.scores[0] <= 1.0
        assert found.scores[-1] >= 0.0
        assert (np.diff(found.scores) <= 0.0).all()


def test_poses_are_rigid_and_near_the_workspace(detector: PoseDetector, scene: Scene) -> None:
    workspace = scene.workspace
    for name, found in detect(detector, scene).items():
        check_poses(found.X_WPs, name)
        p_VPs = found.X_WPs[:, :3, 3] - workspace.p_WV
        assert p_VPs.min() > -MARGIN_M
        assert p_VPs.max() < workspace.edge_m + MARGIN_M


def test_chance_comes_from_the_generator_alone(detector: PoseDetector, scene: Scene) -> None:
    first, again, other = (detect(detector, scene, seed=seed) for seed in (3, 3, 4))
    assert all(same(first[task.name], again[task.name]) for task in MUG_TASKS)
    assert not same(first["grasp"], other["grasp"])


def test_the_scene_is_left_as_it_is(detector: PoseDetector, scene: Scene) -> None:
    before = [array.copy() for array in (scene.p_WPs, scene.p_WSs, scene.grid())]
    detect(detector, scene)
    for array, copy in zip((scene.p_WPs, scene.p_WSs, scene.grid()), before, strict=True):
        assert np.array_equal(array, copy)
