"""Methods that are trained on 20 scenes, saved, loaded, and detect."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from scenarios.clutter.detection import clutter_detectors
from split_drake.bad_input import BadInputError
from split_drake.baselines.learning import cloud_lessons
from split_drake.baselines.learning.method import method_named, methods
from split_drake.baselines.learning.methods import se3dif
from split_drake.baselines.learning.pupil import Pupil
from split_drake.baselines.learning.train import TrainConfig, train
from split_drake.baselines.se3dif.diffusion import Se3DifSampler
from split_drake.baselines.weights import read_weights
from split_drake.data.dataset import DatasetError, SceneDataset
from split_drake.experiments.run import read_json_lines
from split_drake.scene import Scene
from split_drake.training.trainer import StateError, TrainingDivergedError
from tests.split_drake.baselines.learning.conftest import Lesson
from tests.split_drake.baselines.table_views import side_view, views

QUIET = Console(quiet=True)
STEPS = 200


@pytest.fixture
def few_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make steps of SE(3)-DiffusionFields short: fewer points and grasps."""
    for module in (cloud_lessons, se3dif):
        monkeypatch.setattr(module, "GRASPS", 8)
    monkeypatch.setattr(cloud_lessons, "CLOUD_POINTS", 100)
    monkeypatch.setattr("split_drake.baselines.se3dif.network.GRIPPER_POINTS", 6)
    monkeypatch.setattr(
        "split_drake.baselines.se3dif.detector.Se3DifSampler", partial(Se3DifSampler, 4, 6, 2)
    )


def config(lesson: Lesson, method: str, out: Path, steps: int, **more: object) -> TrainConfig:
    return TrainConfig(
        method,
        lesson.data,
        out,
        fields=lesson.fields,
        steps=steps,
        scenes=1,
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.usefixtures("few_poses")
@pytest.mark.parametrize("method", sorted(methods()))
def test_a_method_learns_and_detects(method: str, lesson: Lesson, tmp_path: Path) -> None:
    out = tmp_path / "run"
    train(config(lesson, method, out, STEPS, log_steps=20), QUIET)
    lines = read_json_lines(out / "curves.jsonl")
    losses = [
        sum(value for key, value in line.items() if key not in ("step", "scenes", "minutes", "of"))
        for line in lines
        if line["of"] == "held out"
    ]
    assert lines[-1]["step"] == STEPS
    assert min(losses) < 0.97 * losses[0], losses
    _, info = read_weights(out / "weights.safetensors")
    assert (info.method, info.dataset_hash) == (
        method,
        SceneDataset.open(lesson.data).dataset_hash,
    )
    assert 0 < info.scenes <= STEPS
    known = clutter_detectors()[method]
    known.check(out / "weights.safetensors")
    finder = known.make(out / "weights.safetensors", None, np.random.default_rng(0))  # type: ignore[arg-type]
    seen = views((1, 0.45, 0.0), (3, 0.55, 0.05), cameras=[side_view()])
    scene = Scene.from_views(seen, lesson.recipe.layout.workspace)
    found = finder.detect(scene, np.random.default_rng(0))
    again = finder.detect(scene, np.random.default_rng(0))
    assert np.array_equal(found.X_WPs, again.X_WPs)
    assert np.all(np.diff(found.scores) <= 0.0)
    other = "giga" if method != "giga" else "vgn"
    with pytest.raises(BadInputError, match=f"holds weights of {method}; expected {other}'s"):
        clutter_detectors()[other].check(out / "weights.safetensors")


def test_a_run_that_was_cut_short_goes_on_as_if_it_had_not_been(
    lesson: Lesson, tmp_path: Path
) -> None:
    train(config(lesson, "vgn", tmp_path / "whole", 14), QUIET)
    train(config(lesson, "vgn", tmp_path / "cut", 5), QUIET)
    train(config(lesson, "vgn", tmp_path / "cut", 14, resume=True), QUIET)
    states = [
        torch.load(tmp_path / name / "state.pt", weights_only=True)["network"]
        for name in ("whole", "cut")
    ]
    for name, value in states[0].items():
        assert torch.equal(value, states[1][name]), name
    with pytest.raises(SystemExit, match="holds a run; --resume it"):
        train(config(lesson, "vgn", tmp_path / "cut", 14), QUIET)
    with pytest.raises(SystemExit, match="method was 'vgn', is 'giga'"):
        train(config(lesson, "giga", tmp_path / "cut", 14, resume=True), QUIET)
    (tmp_path / "cut" / "state.pt").write_bytes(b"broken")
    with pytest.raises(StateError, match="is damaged or no state of a run"):
        train(config(lesson, "vgn", tmp_path / "cut", 14, resume=True), QUIET)


@pytest.mark.usefixtures("few_poses")
def test_a_run_goes_on_in_the_type_that_it_began_in(
    lesson: Lesson, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for faster, steps in ((False, 3), (True, 6)):
        monkeypatch.setattr(se3dif, "uses_bfloat16", lambda _, faster=faster: faster)
        train(config(lesson, "se3dif", tmp_path / "run", steps, resume=steps > 3), QUIET)
    assert "bfloat16" not in json.loads((tmp_path / "run" / "config.json").read_text())


def test_the_weights_are_those_that_did_best(lesson: Lesson) -> None:
    method = method_named("vgn")
    pupil = Pupil(method, method.prepare(SceneDataset.open(lesson.data), lesson.fields), seed=0)
    first = sum(pupil.examine().values())
    assert first == pupil.best_loss == pytest.approx(sum(pupil.examine().values()))
    kept = {name: value.clone() for name, value in pupil.best.items()}
    for parameter in pupil.network.parameters():
        parameter.data += 0.3
    assert sum(pupil.examine().values()) > first == pupil.best_loss
    assert all(torch.equal(kept[name], pupil.best[name]) for name in kept)


def test_a_loss_that_is_not_finite_ends_the_run(lesson: Lesson) -> None:
    method = method_named("vgn")
    pupil = Pupil(method, method.prepare(SceneDataset.open(lesson.data), lesson.fields), seed=0)
    next(pupil.network.parameters()).data[:] = torch.nan
    with pytest.raises((TrainingDivergedError, RuntimeError)):
        pupil.take_step()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda given: given | {"method": "dexnet"}, "--method is 'dexnet'; expected one of giga"),
        (lambda given: given | {"minutes": 1.0}, "minutes=1.0, epochs=None, steps=3; expected one"),
        (lambda given: given | {"fields": None}, "--fields is missing: the method learns from"),
    ],
)
def test_what_cannot_be_trained_is_refused(
    change: Callable[[dict[str, object]], dict[str, object]],
    says: str,
    lesson: Lesson,
    tmp_path: Path,
) -> None:
    given: dict[str, object] = {"method": "vgn", "data": lesson.data, "out": tmp_path / "run"}
    with pytest.raises(BadInputError, match=says):
        train(TrainConfig(**change(given | {"fields": lesson.fields, "steps": 3})), QUIET)  # type: ignore[arg-type]


def test_fields_of_another_dataset_are_refused(lesson: Lesson, tmp_path: Path) -> None:
    folder = tmp_path / "fields"
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps({"dataset_hash": "abc"}))
    given = TrainConfig("vgn", lesson.data, tmp_path / "run", fields=folder, steps=1)
    with pytest.raises(DatasetError, match="holds the fields of dataset abc; expected those of"):
        train(given, QUIET)
