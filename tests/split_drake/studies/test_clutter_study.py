"""The study of samplers in clutter: what its figures mean, and that it goes on."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from split_drake.experiments.run import AnotherRunError
from split_drake.pose_set import ALL_ACCEPTED, Acceptance, ScoredPoses
from split_drake.poses import make_pose, rotation_x
from split_drake.split.detector import CLUTTER_SAMPLER
from split_drake.station.layout import Layout
from split_drake.studies import clutter_study
from split_drake.studies.clutter_study import (
    ClutterStudyConfig,
    StudyScene,
    drawn_scenes,
    figures,
    main,
    missing,
    samplers,
)
from split_drake.studies.sampler_study import SHORT, Sampler
from tests.helpers.checkpoints import save_new_network
from tests.split_drake.data.clutter.conftest import Blocks, write_library

ALOFT = make_pose(rotation_x(np.pi), (0.5, 0.0, 0.24))


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> ClutterStudyConfig:
    folder = tmp_path_factory.mktemp("study")
    write_library(Blocks(), folder / "blocks.npz")
    save_new_network(folder / "new.safetensors")
    return ClutterStudyConfig(folder / "new.safetensors", folder / "blocks.npz", folder / "out", 2)


@pytest.fixture(autouse=True)
def _blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clutter_study, "clutter_source", lambda split: Blocks())


@pytest.fixture(scope="module")
def scene(config: ClutterStudyConfig) -> StudyScene:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clutter_study, "clutter_source", lambda split: Blocks())
        return drawn_scenes(config, Layout())[0]


def samples(scene: StudyScene, scores: Sequence[float]) -> ScoredPoses:
    """Return true grasps of the scene with these scores, and behind them one in the air."""
    grasps = scene.drawn.grasps
    best = np.argsort(-grasps.weights)[: len(scores) - 1]
    return ScoredPoses(np.concatenate([grasps.X_WGs[best], ALOFT[None]]), np.array(scores))


FROM_03 = Acceptance(0.3, 0.3)


def test_figures_tell_good_samples_from_accepted_ones(scene: StudyScene) -> None:
    found = figures(scene, samples(scene, [0.9, 0.6, 0.1, 0.4]), FROM_03)
    assert found["samples_good"] == 0.75
    assert found["accepted"] == 0.75
    assert found["accepted_good"] == pytest.approx(2.0 / 3.0)
    assert found["best_good"] == 1.0
    assert figures(scene, samples(scene, [0.9, 0.6, 0.1, 0.95]), FROM_03)["best_good"] == 0.0
    nothing = figures(scene, samples(scene, [0.1, 0.1, 0.1, 0.1]), FROM_03)
    assert nothing["objects"] == nothing["accepted"] == 0.0
    assert np.isnan(nothing["accepted_good"])


def test_grasps_belong_to_the_object_that_they_are_at(scene: StudyScene) -> None:
    grasps = scene.drawn.grasps
    good = scene.judge.check(grasps.X_WGs).good & (grasps.weights > 0.0)
    sampled = ScoredPoses(grasps.X_WGs[good], np.ones(good.sum()))
    reached = set(scene.objects_of(sampled.X_WPs))
    assert figures(scene, sampled, ALL_ACCEPTED)["objects"] == len(reached) / len(
        scene.drawn.objects
    )
    middles = np.array([X[:3, 3] for X in scene.drawn.X_WOs])
    nearest = np.linalg.norm(sampled.X_WPs[:, None, :3, 3] - middles, axis=-1).argmin(axis=1)
    assert (nearest == scene.objects_of(sampled.X_WPs)).mean() > 0.8


def test_the_shipped_sampler_is_among_those_compared() -> None:
    langevin = CLUTTER_SAMPLER.langevin
    shipped = Sampler(SHORT, langevin.evaluations, langevin.temperature)
    assert samplers().count(shipped) == 1


def test_a_study_goes_on_where_it_stopped(
    config: ClutterStudyConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = [Sampler("langevin", 5), Sampler("multistep", 5)]
    monkeypatch.setattr(clutter_study, "samplers", lambda: some[:1])
    main(config)
    first = json.loads((config.out / "study.json").read_text())
    assert [row["evaluations"] for row in first] == [5]
    assert {"samples_good", "best_good", "objects", "sample_s"} <= first[0].keys()
    monkeypatch.setattr(clutter_study, "samplers", lambda: some)
    assert list(missing(first)) == some[1:]
    assert list(missing([], [some[1].name])) == some[1:2]
    main(config)
    both = json.loads((config.out / "study.json").read_text())
    page = (config.out / "index.html").read_text()
    assert page.count('<tr id="setting-') == len(both) and "best good, %" in page
    assert both[:1] == first
    assert [row["integrator"] for row in both] == ["langevin", "multistep"]
    other = ClutterStudyConfig(config.checkpoint, config.library, config.out, 2, seed=1)
    with pytest.raises(AnotherRunError, match="seed was 0, is 1"):
        main(other)


def test_impossible_options_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--scenes is 0; expected 1 or more"):
        ClutterStudyConfig(tmp_path, tmp_path, tmp_path, scenes=0)


def test_samplers_that_there_are_not_are_refused(config: ClutterStudyConfig) -> None:
    with pytest.raises(ValueError, match=r"--samplers has 'euler_004'; expected some of langevin"):
        replace(config, samplers=("langevin_016", "euler_004"))
