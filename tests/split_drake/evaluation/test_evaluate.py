"""The evaluation's command: its options, and what it refuses."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from split_drake.evaluation import evaluate as evaluate_module
from split_drake.evaluation import scenes as eval_scenes
from split_drake.evaluation.evaluate import (
    EvaluateConfig,
    MugEvalOptions,
    describe_detector,
    main,
    require_shippable,
    require_unseen,
)
from split_drake.evaluation.evaluation import Evaluation
from split_drake.evaluation.scenes import EvalMugs, EvalOptions
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask
from split_drake.scene import Workspace
from split_drake.split.checkpoint import CheckpointInfo, default_weights, load_checkpoint
from split_drake.split.detector import SIXTEEN_EVALUATIONS, SamplerConfig, SplitDetector
from split_drake.split.network_config import SplitConfig
from split_drake.station.layout import Layout


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MugEvalOptions(scenes=0), "scenes is 0; expected at least 1"),
        (lambda: MugEvalOptions(scenes_per_mug=0), "scenes_per_mug is 0; expected at least 1"),
        (lambda: EvalOptions(physics_scenes=-1), "physics_scenes is -1; expected at least 0"),
        (lambda: EvalOptions(noise_m=-0.001), "noise_m is -0.001; expected a number from 0 to 0.1"),
        (lambda: MugEvalOptions(noise_m=-0.001), "noise_m is -0.001; expected a number from 0"),
        (
            lambda: MugEvalOptions(mugs="cups"),
            "mugs are 'cups'; expected train, test, thin, or a f",
        ),
    ],
)
def test_impossible_options_are_refused(make: Callable[[], EvalOptions], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_there_must_be_workers(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="workers is 0; expected at least 1"):
        EvaluateConfig(out=tmp_path, workers=0)


def test_a_folder_of_meshes_gives_mugs_and_their_scenes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(eval_scenes, "RESTS", 1)
    load_mug("test_000").body.mesh.export(tmp_path / "mine.stl")
    options = MugEvalOptions(mugs=str(tmp_path), scenes_per_mug=7)
    mugs = EvalMugs(options.source, Layout())
    assert (mugs.names(), options.wanted()) == (("mine",), 7)
    mug = mugs.make(0, seed=0)
    assert mug.true_grasps is None
    assert mug.draw(np.random.default_rng(0)).p_WSs.shape == (2000, 3)


def test_scenes_are_spread_evenly_over_the_mugs_of_a_split() -> None:
    options = MugEvalOptions(scenes=90)
    assert options.wanted() == 90
    assert len(EvalMugs(options.source, Layout()).names()) == 40


def evaluation(
    options: MugEvalOptions,
    tasks: tuple[PoseTask, ...] = MUG_TASKS,
    workspace: Workspace | None = None,
) -> Evaluation:
    """Return an evaluation of the weights that ship."""
    layout = Layout(workspace=workspace or Workspace())
    return options.evaluation(SplitDetector.from_checkpoint, {"name": "split"}, tasks, layout)


def test_scenes_are_those_that_the_options_say() -> None:
    asked = evaluation(MugEvalOptions(scenes=90, physics_scenes=3, noise_m=0.001, seed=5))
    assert asked.options == EvalOptions(physics_scenes=3, noise_m=0.001, seed=5)
    assert asked.subjects == EvalMugs(MugSource("test"), asked.subjects.layout)
    assert asked.scenes == 90


def test_a_question_is_about_all_but_how_many_scenes_there_are() -> None:
    question = evaluation(MugEvalOptions(scenes=90)).question()
    assert evaluation(MugEvalOptions(scenes=91)).question() == question
    elsewhere = Workspace(p_WCenter=(0.4, 0.0, 0.0))
    others: list[dict[str, Any]] = [
        evaluation(MugEvalOptions(seed=1)).question(),
        evaluation(MugEvalOptions(mugs="train")).question(),
        evaluation(MugEvalOptions(), tasks=(GRASP,)).question(),
        evaluation(MugEvalOptions(), workspace=elsewhere).question(),
    ]
    assert question not in others


def test_other_meshes_are_told_apart(tmp_path: Path) -> None:
    source = MugSource(str(tmp_path))
    trimesh.creation.box().export(tmp_path / "one.stl")
    before = source.sha256()
    assert before == source.sha256()
    trimesh.creation.icosphere().export(tmp_path / "one.stl")
    assert source.sha256() != before


def info(commit: str = "c0ffee", earlier_commits: tuple[str, ...] = ()) -> CheckpointInfo:
    """Return the provenance of a checkpoint."""
    return CheckpointInfo(
        config=SplitConfig(),
        tasks=MUG_TASKS,
        workspace=Workspace(),
        training={},
        seed=0,
        dataset_hash="train",
        commit=commit,
        steps=1,
        scenes=8,
        earlier_commits=earlier_commits,
    )


def test_figures_on_mugs_of_the_training_are_refused(tmp_path: Path) -> None:
    require_unseen("test")
    with pytest.raises(SystemExit, match="--allow-training-data"):
        main(EvaluateConfig(out=tmp_path / "out", mugs="train", scenes=1))
    assert not (tmp_path / "out").exists()


def test_a_checkpoint_of_tasks_that_mugs_lack_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_lids = replace(info(), tasks=(GRASP, PoseTask("lid")))
    monkeypatch.setattr(evaluate_module, "load_checkpoint", lambda _: (None, of_lids))
    with pytest.raises(SystemExit, match=r"^test_000 has no poses of 'lid'; it has those of"):
        main(EvaluateConfig(out=tmp_path / "out", scenes=1))
    assert not (tmp_path / "out").exists()


def test_checkpoints_of_unknown_source_are_not_shipped() -> None:
    require_shippable(info(), allow_dirty=False)
    require_shippable(info("c0ffee-dirty"), allow_dirty=True)
    with pytest.raises(SystemExit, match="differed from its commit, c0ffee-dirty"):
        require_shippable(info("c0ffee-dirty"), allow_dirty=False)
    with pytest.raises(SystemExit, match="unknown"):
        require_shippable(info(earlier_commits=("unknown",)), allow_dirty=True)


def test_a_detector_is_known_by_its_weights_and_settings(tmp_path: Path) -> None:
    _, provenance = load_checkpoint(default_weights())
    described = describe_detector(default_weights(), provenance, SamplerConfig())
    copy = tmp_path / "copy.safetensors"
    copy.write_bytes(default_weights().read_bytes())
    assert describe_detector(copy, provenance, SamplerConfig()) == described
    copy.write_bytes(default_weights().read_bytes() + b" ")
    assert describe_detector(copy, provenance, SamplerConfig()) != described
    assert described["sampler"]["samples"] == 256
    longer = describe_detector(default_weights(), provenance, SIXTEEN_EVALUATIONS)
    assert longer != described
