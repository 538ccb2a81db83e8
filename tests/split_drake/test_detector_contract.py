"""What every pose detector keeps to: the oracle, SPLIT and the baselines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import pytest
import torch

from split_drake.baselines.giga.detector import GigaDetector
from split_drake.baselines.giga.network import GigaNetwork
from split_drake.baselines.se3dif.detector import Se3DifDetector
from split_drake.baselines.se3dif.diffusion import Se3DifSampler
from split_drake.baselines.se3dif.network import Se3DifNetwork
from split_drake.baselines.vgn.detector import VgnDetector
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.baselines.weights import load_weights
from split_drake.grasps.sampling import sample_grasps
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseDetector, PoseSet
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask, Symmetry, UnknownTaskError
from split_drake.poses import check_poses, make_pose, rotation_z
from split_drake.scene import Scene
from split_drake.split.detector import SamplerConfig, SplitDetector
from split_drake.station.station import Station
from split_drake.truth.oracle import OracleDetector
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION

# A gripper frame lies between the pads: grasps of what is in the workspace are hardly outside.
MARGIN_M = 0.03
WEIGHTS = MODELS_FOLDER / "weights"


@cache
def mug_on_table() -> tuple[Station, Scene]:
    """Return a station with an unseen mug upright on the table, and what its cameras see."""
    station = Station(STATION, [load_mug("test_001").body])
    station.place_object(0, make_pose(rotation_z(0.8), (0.51, -0.02, 0.0)))
    return station, Scene.from_views(station.capture(), station.config.layout.workspace)


@dataclass(frozen=True)
class Subject:
    """A detector, and what may be expected of it.

    Attributes:
        detector: that is tried.
        tasks: that it knows.
        draws: whether chance plays a part.
        needs_views: whether a cloud alone is not enough.
    """

    detector: PoseDetector
    tasks: tuple[PoseTask, ...] = (GRASP,)
    draws: bool = False
    needs_views: bool = False


def oracle() -> Subject:
    """Return the oracle for the mug; fewer grasps than it has, so that chance plays a part."""
    mug = load_mug("test_001")
    labels = sample_grasps(mug.body, np.random.default_rng(0), positives=200)
    detector = OracleDetector(Truth(mug_on_table()[0]), mug, labels, max_grasps=50)
    return Subject(detector, MUG_TASKS, draws=True)


def split() -> Subject:
    """Return SPLIT; 64 samples show as much as 256."""
    detector = SplitDetector.from_checkpoint(config=SamplerConfig(samples=64))
    return Subject(detector, MUG_TASKS, draws=True)


def vgn() -> Subject:
    network = load_weights(VgnNetwork(), "vgn", WEIGHTS / "vgn.safetensors")
    return Subject(VgnDetector(network), needs_views=True)


def giga() -> Subject:
    network = load_weights(GigaNetwork(), "giga", WEIGHTS / "giga.safetensors")
    return Subject(GigaDetector(network), needs_views=True)


def se3dif(segments: bool) -> Subject:
    """Return SE(3)-DiffusionFields with new weights: what it keeps to does not depend on them."""
    torch.manual_seed(0)
    sampler = Se3DifSampler(samples=24, steps=4, still_steps=2)
    return Subject(Se3DifDetector(Se3DifNetwork(), segments, sampler), draws=True)


MAKERS: dict[str, Callable[[], Subject]] = {
    "oracle": oracle,
    "split": split,
    "vgn": vgn,
    "giga": giga,
    "se3dif": partial(se3dif, False),
    "se3dif_segments": partial(se3dif, True),
}


@pytest.fixture(scope="module", params=MAKERS)
def subject(request: pytest.FixtureRequest) -> Subject:
    return MAKERS[request.param]()


@pytest.fixture
def scene() -> Scene:
    return mug_on_table()[1]


def detect(
    subject: Subject, scene: Scene, tasks: Sequence[PoseTask | str] | None = None, seed: int = 0
) -> dict[str, PoseSet]:
    """Return the pose sets for a seed, of all tasks where none are named."""
    asked = subject.tasks if tasks is None else tasks
    return subject.detector.detect(scene, asked, np.random.default_rng(seed))


def same(first: PoseSet, second: PoseSet) -> bool:
    """Return whether two pose sets are equal bit by bit."""
    return np.array_equal(first.X_WPs, second.X_WPs) and np.array_equal(first.scores, second.scores)


def test_there_is_one_set_for_each_task_asked_for(subject: Subject, scene: Scene) -> None:
    known = subject.tasks
    for tasks in dict.fromkeys((known, known[::-1], known[-1:], known[:2])):
        sets = detect(subject, scene, tasks)
        assert [*sets] == [task.name for task in tasks]
        for task in tasks:
            found = sets[task.name]
            assert found.task == task
            assert len(found) > 0, "a mug in plain view has poses for all tasks"


def test_tasks_may_be_asked_for_by_their_names(subject: Subject, scene: Scene) -> None:
    asked = subject.tasks[-2:]
    by_name = detect(subject, scene, (asked[0].name, *asked[1:]))
    assert [found.task.name for found in by_name.values()] == [*by_name]
    meant = detect(subject, scene, asked)
    assert all(same(by_name[name], meant[name]) for name in by_name)


@pytest.mark.parametrize("task", ["peel", PoseTask("lid")], ids=str)
def test_unknown_tasks_are_refused_and_those_known_named(
    subject: Subject, scene: Scene, task: PoseTask | str
) -> None:
    known = ", ".join(each.name for each in subject.tasks)
    with pytest.raises(UnknownTaskError, match=f"no task '{task}'.*{known}"):
        detect(subject, scene, (GRASP, task))


def test_a_task_of_another_symmetry_is_another_task(subject: Subject, scene: Scene) -> None:
    known = subject.tasks[-1]
    turning = PoseTask(known.name, Symmetry.any_turn("z"))
    with pytest.raises(UnknownTaskError, match=rf"'any turn'.*'{known.symmetry.kind}'"):
        detect(subject, scene, (turning,))


def test_no_task_gives_no_set(subject: Subject, scene: Scene) -> None:
    assert detect(subject, scene, ()) == {}


def test_scores_descend_from_one_at_most_to_zero_at_least(subject: Subject, scene: Scene) -> None:
    for found in detect(subject, scene).values():
        assert found.scores.shape == (len(found),)
        assert found.scores[0] <= 1.0
        assert found.scores[-1] >= 0.0
        assert (np.diff(found.scores) <= 0.0).all()


def test_poses_are_rigid_and_near_the_workspace(subject: Subject, scene: Scene) -> None:
    workspace = scene.workspace
    for name, found in detect(subject, scene).items():
        check_poses(found.X_WPs, name)
        p_VPs = found.X_WPs[:, :3, 3] - workspace.p_WV
        assert p_VPs.min() > -MARGIN_M
        assert p_VPs.max() < workspace.edge_m + MARGIN_M


def test_chance_comes_from_the_generator_alone(subject: Subject, scene: Scene) -> None:
    first, again, other = (detect(subject, scene, seed=seed) for seed in (3, 3, 4))
    assert all(same(first[task.name], again[task.name]) for task in subject.tasks)
    assert same(first["grasp"], other["grasp"]) != subject.draws


def test_the_scene_is_left_as_it_is(subject: Subject, scene: Scene) -> None:
    def arrays() -> list[np.ndarray]:
        return [scene.p_WPs, scene.p_WSs, scene.grid(), *(view.depth_m for view in scene.views)]

    before = [array.copy() for array in arrays()]
    detect(subject, scene)
    for array, copy in zip(arrays(), before, strict=True):
        assert np.array_equal(array, copy)


def test_a_cloud_alone_is_enough_or_refused(subject: Subject, scene: Scene) -> None:
    blind = replace(scene, views=())
    if subject.needs_views:
        with pytest.raises(ValueError, match="no depth views; expected one at least"):
            detect(subject, blind)
    else:
        assert len(detect(subject, blind)[GRASP.name]) > 0
