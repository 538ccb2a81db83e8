"""Setting a trial up and looking at it: mugs passed over, generators, detectors, noise."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.record_problems import RecordOptions
from scenarios.record_problems import specs_of as problem_specs
from scenarios.trials import perception, setup
from scenarios.trials.detection import Detectors, TrialDetector, trial_detector
from scenarios.trials.perception import Perceiver
from scenarios.trials.pose_noise import NoisyDetector, PoseNoise
from scenarios.trials.setup import (
    OTHER_KINDS,
    Setup,
    TrialGenerators,
    planner_named,
    set_up,
)
from scenarios.trials.spec import TrialSpec
from split_drake.objects_in_view import objects_in_view
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, PoseTask
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.station.fixtures import TABLE_BODY
from split_drake.station.station import Station
from split_drake.truth.oracle import OracleDetector
from split_drake.truth.starts import NoStartError, Start, outside_workspace
from split_drake.truth.state import Truth
from tests.helpers.checkpoints import save_new_network

SPEC = specs_of(
    MugHangOptions(trials=1, seed=3, detector="oracle", record="none"), Path("nowhere"), ()
)[0]


def starting_with(accepted: str) -> Callable[..., Start]:
    """Return a stand-in for `draw_start` that only one mug pleases, and that after one redraw."""

    def draw(station: Station, truth: Truth, *_: object) -> Start:
        (mug,) = station.objects
        if mug.name != accepted:
            raise NoStartError(mug.name, ["upside down", "still moving"])
        return Start(truth.X_WO(), ("upside down",))

    return draw


@pytest.fixture(autouse=True)
def _three_mugs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TrialSpec, "mug_names", lambda spec: ("test_003", "test_004", "test_005"))


def ready(monkeypatch: pytest.MonkeyPatch, accepted: str = "test_003") -> Setup:
    monkeypatch.setattr(setup, "draw_start", starting_with(accepted))
    return set_up(SPEC, TrialGenerators.of(0))


def test_mugs_that_will_not_lie_as_wanted_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    found = ready(monkeypatch, accepted="test_005")
    assert found.mug.name == "test_005" and found.recorder is None
    assert found.redraws == {
        "upside down": 3,
        "still moving": 2,
        "passed over test_003": 1,
        "passed over test_004": 1,
    }


def test_where_no_mug_will_the_error_counts_all_redraws(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        NoStartError, match="starts of all mugs of test were all rejected"
    ) as caught:
        ready(monkeypatch, accepted="none")
    assert caught.value.redraws.count("upside down") == 3


def test_each_part_of_a_trial_has_its_own_generator() -> None:
    def drawn(seed: int) -> list[float]:
        rngs = TrialGenerators.of(seed)
        return [rng.random() for rng in (rngs.start, rngs.noise, rngs.detector, rngs.planner)]

    assert drawn(5) == drawn(5)
    assert len({*drawn(5), *drawn(6)}) == 8
    assert planner_named("rrt") is planner_named("rrt"), "it keeps its collision world"


def test_the_oracle_is_noisy_where_asked_and_knows_no_wider_poses(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = ready(monkeypatch)
    known = trial_detector("oracle").make(SPEC, found)
    assert isinstance(known.usual, OracleDetector)
    assert known.usual is known.again is known.again_for_grasps
    noise = PoseNoise(0.003, 0.0)
    noisy = trial_detector("oracle").make(replace(SPEC, pose_noise=noise), found).usual
    assert isinstance(noisy, NoisyDetector) and noisy.noise == noise
    from_files = replace(SPEC, mugs=replace(SPEC.mugs, where=str(tmp_path)), folder=tmp_path)
    with pytest.raises(FileNotFoundError, match=r"grasps/test_003\.npz"):
        trial_detector("oracle").make(from_files, found)


class Asked:
    """A detector that finds nothing and notes what it is asked for, and in what scene."""

    def __init__(self) -> None:
        self.tasks: list[tuple[PoseTask | str, ...]] = []
        self.p_WSs: list[Array] = []

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        self.tasks.append(tuple(tasks))
        self.p_WSs.append(scene.p_WSs)
        return {str(task): PoseSet(GRASP, np.empty((0, 4, 4)), np.empty(0)) for task in tasks}


def watching(found: Setup, asked: Sequence[Asked], monkeypatch: pytest.MonkeyPatch) -> Perceiver:
    """Return eyes that ask the three given, in the order of `Detectors`."""
    detector = TrialDetector("asked", make=lambda *_: Detectors(*asked))
    monkeypatch.setattr(perception, "trial_detector", lambda _: detector)
    return Perceiver(SPEC, found, TrialGenerators.of(0))


def test_a_look_again_asks_who_takes_his_time_and_grasps_of_who_spreads_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = usual, again, again_for_grasps = Asked(), Asked(), Asked()
    eyes = watching(ready(monkeypatch), asked, monkeypatch)
    eyes.look([GRASP, HANDLE])
    assert usual.tasks == [(GRASP, HANDLE)] and not again.tasks + again_for_grasps.tasks
    eyes.look([HANDLE], again=True)
    assert again.tasks == [(HANDLE,)] and not again_for_grasps.tasks
    eyes.look([GRASP], again=True)
    assert again.tasks == [(HANDLE,)] and again_for_grasps.tasks == [(GRASP,)]
    _, pose_sets = eyes.look([GRASP, HANDLE], again=True)
    assert set(pose_sets) == {"grasp", "handle"} and len(usual.tasks) == 1
    np.testing.assert_array_equal(again.p_WSs[-1], again_for_grasps.p_WSs[-1])


def test_each_look_has_noise_of_its_own_on_the_sampled_points(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = ready(monkeypatch)
    eyes = watching(found, [Asked() for _ in range(3)], monkeypatch)
    clean = Scene.from_views(found.station.capture(), SPEC.station.layout.workspace)
    one, other = (eyes.look([GRASP])[0] for _ in range(2))
    for scene in (one, other):
        np.testing.assert_array_equal(scene.p_WPs, clean.p_WPs)
        assert (scene.p_WSs - clean.p_WSs).std() == pytest.approx(SPEC.noise_m, rel=0.1)
    assert np.abs(one.p_WSs - other.p_WSs).std() > 0.5 * SPEC.noise_m


def test_trials_look_where_their_model_was_trained_to(tmp_path: Path) -> None:
    path, workspace = tmp_path / "moved.safetensors", Workspace((0.52, 0.03, 0.0))
    save_new_network(path, workspace)
    (spec,) = specs_of(MugHangOptions(trials=1, checkpoint=path), tmp_path, ())
    assert spec.station.layout.workspace == workspace
    (problem,) = problem_specs(RecordOptions(count=1, detectors=("split",), checkpoint=path))
    assert problem.station.layout.workspace == workspace
    assert SPEC.station.layout.workspace == Workspace()


def test_other_things_stand_apart_beside_the_mug() -> None:
    alone, found = (set_up(replace(SPEC, objects=count), TrialGenerators.of(0)) for count in (0, 2))
    station, truth = found.station, found.truth
    assert len(station.objects) == 3
    assert {item.name.partition("_")[0] for item in station.objects[1:]} <= set(OTHER_KINDS)
    np.testing.assert_allclose(truth.X_WO(0), alone.truth.X_WO(0), atol=1e-3)
    workspace = station.config.layout.workspace
    for index in range(3):
        assert outside_workspace(station.objects[index], truth.X_WO(index), workspace) == ""
    for index in (1, 2):
        assert truth.X_WO(index)[2, 2] > 0.99
        assert truth.touching(index) == {TABLE_BODY}
    scene = Scene.from_views(station.capture(), workspace)
    assert len(objects_in_view(scene.p_WPs)) == 3


def test_more_than_the_table_has_room_for_is_told() -> None:
    with pytest.raises(NoStartError, match="starts of all mugs of test were all rejected"):
        set_up(replace(SPEC, objects=20), TrialGenerators.of(0))


def test_cameras_err_as_they_are_told_to_and_alike_for_a_seed() -> None:
    noisy = replace(SPEC, station=replace(SPEC.station, depth_noise="middle"))
    first, same = (set_up(noisy, TrialGenerators.of(0)).station.capture() for _ in range(2))
    (clean, *_), (view, *_) = set_up(SPEC, TrialGenerators.of(0)).station.capture(), first
    np.testing.assert_array_equal(view.depth_m, same[0].depth_m)
    seen = (view.depth_m > 0.0) & (clean.depth_m > 0.0)
    errors = np.abs(view.depth_m - clean.depth_m)[seen]
    assert 0.0002 < np.median(errors) < 0.001
    with pytest.raises(ValueError, match="depth_noise is 'middle'; it needs a sensor_rng"):
        Station(noisy.station)
