"""Where grasps come from in clutter removal."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.clutter.clearing import HandClearing
from scenarios.clutter.detection import (
    FoundBy,
    UnknownDetectorError,
    clutter_detector,
    clutter_detectors,
    ranked,
)
from scenarios.clutter.detectors import oracle as oracle_file
from scenarios.clutter.detectors import split, split_8, split_16, split_once
from scenarios.clutter.detectors.oracle import TrueGrasps
from scenarios.clutter.observation import observe, side_camera
from split_drake.baselines.published import PublishedWeightsError
from split_drake.baselines.weights import BaselineWeightsError
from split_drake.data.clutter.labels import clears_table
from split_drake.data.clutter.library import ObjectGrasps
from split_drake.objects.rigid import RigidObject
from split_drake.pose_task import GRASP, UPRIGHT, UnknownTaskError
from split_drake.poses import invert_pose, make_pose, transform_points
from split_drake.scene import Scene
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from tests.helpers.checkpoints import save_new_network
from tests.split_drake.station.solids import clear, solids, stand

LAYOUT = Layout()
CAN, TIN = 1, 3


@pytest.fixture(scope="module")
def shared() -> HandStation:
    return HandStation(solids(), LAYOUT)


@pytest.fixture
def station(shared: HandStation) -> HandStation:
    clear(shared)
    return shared


def look(station: HandStation) -> Scene:
    (view,) = station.capture([side_camera(LAYOUT.workspace)])
    return observe(view, LAYOUT.workspace, "none", np.random.default_rng(0))


def oracle(station: HandStation) -> TrueGrasps:
    clearing = HandClearing(station, side_camera(LAYOUT.workspace))
    return TrueGrasps(clearing, np.random.default_rng(0))


def test_true_grasps_pinch_what_stands_there(station: HandStation) -> None:
    stand(station, CAN, 0.47)
    stand(station, TIN, 0.55, 0.02)
    found = oracle(station).detect(look(station), np.random.default_rng(0))
    assert len(found.scores) > 20
    assert clears_table(found.X_WPs, 0.0).all()
    distances = [
        np.linalg.norm(found.X_WPs[:, :2, 3] - (x, y), axis=1)
        for x, y in ((0.47, 0.0), (0.55, 0.02))
    ]
    assert (np.minimum(*distances) < 0.035).all()
    assert all((each < 0.035).any() for each in distances)


def test_true_grasps_follow_an_object_that_moved(station: HandStation) -> None:
    stand(station, CAN, 0.47)
    finder = oracle(station)
    before = finder.detect(look(station), np.random.default_rng(0))
    station.place_object(CAN, make_pose(p=(0.55, 0.03, 0.0005)))
    after = finder.detect(look(station), np.random.default_rng(0))
    assert abs(np.median(before.X_WPs[:, 0, 3]) - 0.47) < 0.01
    assert abs(np.median(after.X_WPs[:, 0, 3]) - 0.55) < 0.01


def test_grasps_of_an_object_are_worked_out_once(
    station: HandStation, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    work_out = oracle_file.object_grasps

    def count(body: RigidObject, rng: np.random.Generator) -> ObjectGrasps:
        asked.append(body.name)
        return work_out(body, rng)

    monkeypatch.setattr(oracle_file, "object_grasps", count)
    finder = oracle(station)
    stand(station, CAN)
    for _ in range(2):
        finder.detect(look(station), np.random.default_rng(0))
    assert asked == ["can"]


def test_what_is_gone_has_no_grasps(station: HandStation) -> None:
    stand(station, CAN, 0.47)
    stand(station, TIN, 0.55)
    finder, scene = oracle(station), look(station)
    station.park_object(TIN)
    found = finder.detect(scene, np.random.default_rng(0))
    assert (found.X_WPs[:, 0, 3] < 0.51).all()


def test_grasps_are_ranked_by_their_scores() -> None:
    X_WGs = make_pose(p=np.arange(9.0).reshape(3, 3))
    found = ranked(X_WGs, [0.2, 0.9, 0.2])
    assert found.task == GRASP
    assert found.scores.tolist() == [0.9, 0.2, 0.2]
    assert found.X_WPs[:, 0, 3].tolist() == [3.0, 0.0, 6.0], "ties stay in their order"
    assert len(ranked(np.empty((0, 4, 4)), ()).scores) == 0


def test_split_is_asked_for_grasps_alone(station: HandStation, tmp_path: Path) -> None:
    save_new_network(tmp_path / "new.safetensors")
    stand(station, CAN)
    found = FoundBy(split.load(tmp_path / "new.safetensors")).detect(
        look(station), np.random.default_rng(0)
    )
    assert found.task == GRASP
    save_new_network(tmp_path / "upright.safetensors", tasks=(UPRIGHT,))
    with pytest.raises(UnknownTaskError, match="has no task 'grasp'; it has upright"):
        FoundBy(split.load(tmp_path / "upright.safetensors")).detect(
            look(station), np.random.default_rng(0)
        )


def test_methods_are_files_of_a_room() -> None:
    assert {"oracle", "split", "vgn", "giga"} <= set(clutter_detectors())


def test_a_method_and_its_checkpoint_must_fit(tmp_path: Path) -> None:
    weights = tmp_path / "w.safetensors"
    with pytest.raises(UnknownDetectorError, match="--detector is 'vng'; expected one of giga, or"):
        clutter_detector("vng", None)
    with pytest.raises(UnknownDetectorError, match="--detector split needs --checkpoint: weights"):
        clutter_detector("split", None)
    with pytest.raises(UnknownDetectorError, match="--checkpoint: there is no file"):
        clutter_detector("split", weights)
    weights.touch()
    with pytest.raises(UnknownDetectorError, match="--detector oracle has no parameters; leave"):
        clutter_detector("oracle", weights)
    assert clutter_detector("split", weights).name == "split"


def test_a_method_is_loaded_once_a_process(station: HandStation, tmp_path: Path) -> None:
    save_new_network(tmp_path / "new.safetensors")
    clearing = HandClearing(station, side_camera(LAYOUT.workspace))
    method, rng = clutter_detector("split", tmp_path / "new.safetensors"), np.random.default_rng(0)
    first = method.make(tmp_path / "new.safetensors", clearing, rng)
    assert method.make(tmp_path / "new.safetensors", clearing, rng) is first


def test_the_side_view_shows_the_side(station: HandStation) -> None:
    stand(station, CAN)
    camera, scene = side_camera(LAYOUT.workspace), look(station)
    p_CPs = transform_points(invert_pose(camera.X_WC), scene.p_WPs)
    assert (np.abs(p_CPs[:, 2] - 0.6) < 0.1).all()
    towards = scene.p_WPs[:, 1] < 0.005
    assert towards.mean() > 0.8, "the camera stands at -y"


def test_a_checkpoint_of_no_use_is_told_before_the_first_round(tmp_path: Path) -> None:
    weights = tmp_path / "upright.safetensors"
    save_new_network(weights, tasks=(UPRIGHT,))
    with pytest.raises(
        UnknownTaskError, match=r"upright.safetensors has no task 'grasp'; it has up"
    ):
        clutter_detector("split", weights).check(weights)
    with pytest.raises(BaselineWeightsError, match=r"upright.safetensors is of format .*split"):
        clutter_detector("giga", weights).check(weights)
    plain = tmp_path / "weights.pt"
    plain.write_bytes(b"nothing of PyTorch's")
    with pytest.raises(PublishedWeightsError, match=r"weights.pt is no PyTorch state dictionary"):
        clutter_detector("giga", plain).check(plain)
    clutter_detector("oracle", None).check(None)


def test_variants_of_split_differ_in_evaluations_and_looks(tmp_path: Path) -> None:
    path = tmp_path / "new.safetensors"
    save_new_network(path)
    configs = [each.load(path).config for each in (split, split_16, split_once, split_8)]
    assert [each.langevin.evaluations for each in configs] == [4, 16, 4, 8]
    assert [each.close_ups for each in configs] == [24, 24, 0, 0]
    assert len({each.acceptance for each in configs[:3]}) == 1
