"""The evaluation's command: its options, and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.evaluation import scenes as eval_scenes
from split_drake.evaluation.evaluate import (
    EvaluateConfig,
    describe_detector,
    main,
    require_shippable,
    require_unseen,
)
from split_drake.evaluation.scenes import EvalMugs, EvalOptions
from split_drake.objects.mugs.split import load_mug
from split_drake.split.checkpoint import CheckpointInfo, default_weights, load_checkpoint
from split_drake.split.network import SplitConfig


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scenes": 0}, "scenes is 0; expected at least 1"),
        ({"scenes_per_mug": 0}, "scenes_per_mug is 0; expected at least 1"),
        ({"physics_scenes": -1}, "physics_scenes is -1; expected at least 0"),
        ({"noise_m": -0.001}, "noise_m is -0.001; expected a standard deviation"),
        ({"mugs": "cups"}, "mugs are 'cups'; expected train, test, or a folder"),
    ],
)
def test_impossible_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        EvalOptions(**options)  # type: ignore[arg-type]


def test_there_must_be_workers(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="workers is 0; expected at least 1"):
        EvaluateConfig(out=tmp_path, workers=0)


def test_a_folder_of_meshes_gives_mugs_and_their_scenes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(eval_scenes, "RESTS", 1)
    load_mug("test_000").body.mesh.export(tmp_path / "mine.stl")
    options = EvalOptions(mugs=str(tmp_path), scenes_per_mug=7)
    mugs = EvalMugs(options)
    assert (mugs.names, mugs.scenes()) == (("mine",), 7)
    assert mugs.of_scene(0) is mugs.of_scene(6)
    assert mugs.of_scene(0).true_grasps is None
    assert mugs.of_scene(0).draw(np.random.default_rng(0)).p_WSs.shape == (2000, 3)


def test_scenes_are_spread_evenly_over_the_mugs_of_a_split() -> None:
    mugs = EvalMugs(EvalOptions(scenes=90))
    assert mugs.scenes() == 90
    assert len(mugs.names) == 40


def test_other_meshes_are_told_apart(tmp_path: Path) -> None:
    options = EvalOptions(mugs=str(tmp_path))
    trimesh.creation.box().export(tmp_path / "one.stl")
    before = options.source.sha256()
    assert before == options.source.sha256()
    trimesh.creation.icosphere().export(tmp_path / "one.stl")
    assert options.source.sha256() != before


def info(commit: str = "c0ffee", **changes: object) -> CheckpointInfo:
    """Return the provenance of a checkpoint."""
    provenance = CheckpointInfo(SplitConfig(), {}, 0, "train", commit, steps=1, scenes=8)
    return replace(provenance, **changes)  # type: ignore[arg-type]


def test_figures_on_mugs_of_the_training_are_refused(tmp_path: Path) -> None:
    require_unseen("test")
    with pytest.raises(SystemExit, match="--allow-training-data"):
        main(EvaluateConfig(out=tmp_path / "out", mugs="train", scenes=1))
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
    described = describe_detector(default_weights(), provenance)
    copy = tmp_path / "copy.safetensors"
    copy.write_bytes(default_weights().read_bytes())
    assert describe_detector(copy, provenance) == described
    copy.write_bytes(default_weights().read_bytes() + b" ")
    assert describe_detector(copy, provenance) != described
    assert described["sampler"]["samples"] == 256
