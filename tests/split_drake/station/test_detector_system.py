"""The detector as a system of the station's diagram."""

from collections.abc import Sequence

import numpy as np
import pytest

from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseSet
from split_drake.pose_task import HANDLE, MUG_TASKS, PoseTask, find_tasks
from split_drake.poses import make_pose
from split_drake.scene import EmptySceneError, Scene
from split_drake.station.detector_system import PoseDetectorSystem
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from tests.helpers.stations import STATION


class MiddleDetector:
    """Puts one pose in the middle of the cloud, and counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        self.calls += 1
        middle = make_pose(p=scene.p_WSs.mean(axis=0))
        known = find_tasks(tasks, MUG_TASKS, "the middle")
        return {task.name: PoseSet(task, middle[None], np.ones(1)) for task in known}


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("train_001")


def _station(mug: MugShape, detector: MiddleDetector, noise_m: float = 0.0) -> Station:
    config = STATION
    system = PoseDetectorSystem(detector, (HANDLE,), config.layout, noise_m, seed=3)
    return Station(config, [mug.body], detector_system=system)


def _pose_sets(station: Station) -> dict[str, PoseSet]:
    port = station.diagram.GetOutputPort("pose_sets")
    return port.Eval(station.simulator.get_context())


def test_pose_sets_follow_the_mug_and_are_computed_once_a_scene(mug: MugShape) -> None:
    detector = MiddleDetector()
    station = _station(mug, detector)
    positions = []
    for y in (0.0, 0.08):
        station.place_object(0, make_pose(p=(0.5, y, 0.0)))
        first, second = _pose_sets(station), _pose_sets(station)
        np.testing.assert_array_equal(first["handle"].X_WPs, second["handle"].X_WPs)
        assert set(first) == {"handle"}
        positions.append(first["handle"].X_WPs[0, :3, 3])
    assert detector.calls == 2
    assert positions[1][1] - positions[0][1] == pytest.approx(0.08, abs=0.01)


def test_scene_is_that_of_the_cameras_with_seeded_noise(mug: MugShape) -> None:
    scenes = []
    for _ in range(2):
        station = _station(mug, MiddleDetector(), noise_m=0.005)
        scenes.append(station.diagram.GetOutputPort("scene").Eval(station.simulator.get_context()))
    plain = Scene.from_views(station.capture(), Layout().workspace)
    np.testing.assert_array_equal(scenes[0].p_WSs, scenes[1].p_WSs)
    np.testing.assert_array_equal(scenes[0].p_WPs, plain.p_WPs)
    assert np.std(scenes[0].p_WSs - plain.p_WSs) == pytest.approx(0.005, rel=0.05)


def test_stepping_does_not_run_the_detector(mug: MugShape) -> None:
    detector = MiddleDetector()
    _station(mug, detector).advance(0.1)
    assert detector.calls == 0


def test_empty_table_is_an_empty_scene(mug: MugShape) -> None:
    station = _station(mug, MiddleDetector())
    station.place_object(0, make_pose(p=(0.9, 0.4, 0.0)))
    with pytest.raises(EmptySceneError):
        _pose_sets(station)


def test_negative_noise_is_refused(mug: MugShape) -> None:
    with pytest.raises(ValueError, match=r"noise_m is -0\.1"):
        _station(mug, MiddleDetector(), noise_m=-0.1)
