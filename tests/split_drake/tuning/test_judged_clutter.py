"""Grasps that a model draws in clutter are judged by geometry."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScene, ClutterScenes
from split_drake.experiments.run import AnotherRunError, claim_folder
from split_drake.pose_set import ScoredPoses
from split_drake.pose_task import PoseTask
from split_drake.poses import make_pose, rotation_x
from split_drake.scene import Scene, Workspace
from split_drake.split.detector import SplitDetector
from split_drake.split.sampling import StepCallback
from split_drake.station.layout import Layout
from split_drake.tuning import judged_clutter
from split_drake.tuning.judged_clutter import (
    JudgeClutterConfig,
    judge_clutter_scene,
    write_judged_clutter,
)
from split_drake.tuning.judged_grasps import JudgedGrasps, write_missing
from tests.helpers.checkpoints import new_network, save_new_network
from tests.split_drake.data.clutter.conftest import Blocks, write_library


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> ClutterRecipe:
    path = tmp_path_factory.mktemp("library") / "blocks.npz"
    write_library(Blocks(), path)
    return ClutterRecipe(Blocks(), path, Layout())


@pytest.fixture(scope="module")
def drawn(recipe: ClutterRecipe) -> ClutterScene:
    return next(ClutterScenes(recipe, np.random.default_rng(0)).draw_all())


class DetectorOf(SplitDetector):
    """Detects the grasps that it is given, whatever it sees."""

    def __init__(self, X_WGs: np.ndarray) -> None:
        super().__init__(new_network(), Workspace())
        self.X_WGs = X_WGs
        self.seen: list[Scene] = []

    def sample(
        self,
        scene: Scene,
        tasks: Sequence[PoseTask | str],
        rng: np.random.Generator,
        callback: StepCallback | None = None,
    ) -> dict[str, ScoredPoses]:
        self.seen.append(scene)
        return {"grasp": ScoredPoses(self.X_WGs, np.zeros(len(self.X_WGs)))}


def test_true_grasps_hold_and_those_in_the_air_do_not(drawn: ClutterScene) -> None:
    aloft = make_pose(rotation_x(np.pi), (0.5, 0.0, 0.24))[None]
    true = drawn.grasps.X_WGs[drawn.grasps.weights > 0.8]
    detector = DetectorOf(np.concatenate([true, aloft]))
    judged = judge_clutter_scene(drawn, detector, np.random.default_rng(0))
    assert judged["held"][:-1].mean() > 0.85
    assert not judged["held"][-1]
    np.testing.assert_allclose(judged["clouds"], drawn.scene.p_WSs, atol=1e-6)
    assert not np.allclose(detector.seen[0].p_WSs, drawn.scene.p_WSs), "what is seen is noisy"


@pytest.fixture
def judging(
    recipe: ClutterRecipe, drawn: ClutterScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> JudgeClutterConfig:
    detector = DetectorOf(drawn.grasps.X_WGs[:3])
    monkeypatch.setattr(SplitDetector, "from_checkpoint", lambda path, config: detector)
    checkpoint = tmp_path / "split.safetensors"
    save_new_network(checkpoint)
    (tmp_path / "judged").mkdir()
    return JudgeClutterConfig(
        checkpoint, recipe.library, tmp_path / "judged", shards=2, scenes_per_shard=2, workers=1
    )


def test_shards_are_of_scenes_of_their_own(
    judging: JudgeClutterConfig, recipe: ClutterRecipe
) -> None:
    record = judging.record() | {"workspace": {"p_WCenter": [0.5, 0.0, 0.0]}}
    write_in_this_process(
        judging.out,
        record,
        judging.names(),
        partial(write_judged_clutter, judging, recipe),
        workers=1,
    )
    read = JudgedGrasps.open(judging.out)
    assert (read.sampled.shape, read.held.shape) == ((4, 3, 4, 4), (4, 3))
    assert len(np.unique(read.clouds.mean(axis=(1, 2)))) == 4
    again = {path.name: path.read_bytes() for path in judging.out.glob("*.npz")}
    write_judged_clutter(judging, recipe, "clutter_0001")
    assert (judging.out / "clutter_0001.npz").read_bytes() == again["clutter_0001.npz"]


def test_judging_goes_on_only_where_it_was_the_same(
    judging: JudgeClutterConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judged_clutter, "clutter_source", lambda split: Blocks())
    monkeypatch.setattr(judged_clutter, "write_missing", write_in_this_process)
    judged_clutter.judge_clutter(judging, Layout())
    with pytest.raises(AnotherRunError, match="samples was 48, is 4"):
        write_missing(
            judging.out, replace(judging, samples=4).record(), judging.names(), pytest.fail, 1
        )


def write_in_this_process(out, record, names, write, workers) -> None:  # type: ignore[no-untyped-def]
    """Write all shards here, where what is patched holds."""
    with claim_folder(out, record | {"shards": list(names)}):
        for name in names:
            write(name)
    write_missing(out, record, names, pytest.fail, workers)


def test_impossible_counts_are_named(judging: JudgeClutterConfig) -> None:
    with pytest.raises(ValueError, match="shards is 0; expected at least 1"):
        replace(judging, shards=0)
