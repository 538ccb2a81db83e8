"""SPLIT as a detector, and its checkpoints.  Accuracy is measured by training.evaluate."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from split_drake.pose_set import ALL_ACCEPTED, Acceptance
from split_drake.pose_task import (
    GRASP,
    MUG_TASKS,
    UPRIGHT,
    PoseTask,
    Symmetry,
    UnknownTaskError,
)
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import (
    CHECKSUM,
    FIRST_WORKSPACE,
    CheckpointError,
    CheckpointInfo,
    content_sha256,
    default_weights,
    load_checkpoint,
    save_checkpoint,
)
from split_drake.split.detector import (
    SIXTEEN_EVALUATIONS,
    WIDE_TEMPERATURE,
    SamplerConfig,
    SplitDetector,
)
from split_drake.split.network import SplitNetwork
from split_drake.split.network_config import SplitConfig
from split_drake.split.sampling import LangevinConfig, ReverseDiffusion
from split_drake.split.stamp import known_hashes

LID = PoseTask("lid", Symmetry.any_turn("z"), "z along the thread")
SAMPLER = SamplerConfig(samples=16, langevin=LangevinConfig(steps=4), acceptance=ALL_ACCEPTED)


@pytest.fixture(scope="module")
def network() -> SplitNetwork:
    torch.manual_seed(0)
    config = SplitConfig(channels=(4, 8, 8), context_grids=(0, 1, 3), width=32, layers=4)
    return SplitNetwork(config, MUG_TASKS)


def detector_of(
    network: SplitNetwork, config: SamplerConfig = SAMPLER, workspace: Workspace | None = None
) -> SplitDetector:
    """Return a detector that was trained on a workspace, the default one where none is given."""
    return SplitDetector(network, workspace or Workspace(), config)


def make_scene(workspace: Workspace | None = None) -> Scene:
    """Return a tube 10 cm high in the middle of the workspace."""
    workspace = workspace or Workspace()
    rng = np.random.default_rng(0)
    angle = rng.uniform(0.0, 2.0 * np.pi, 2000)
    height = rng.uniform(0.005, 0.1, 2000)
    tube = np.stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), height], -1)
    points = tube + workspace.p_WCenter
    return Scene(points, points, workspace)


def test_same_seed_and_scene_give_the_same_poses(network: SplitNetwork) -> None:
    detector = detector_of(network)
    first, again, other = (
        detector.detect(make_scene(), MUG_TASKS, np.random.default_rng(seed)) for seed in (0, 0, 1)
    )
    assert first.keys() == {"grasp", "handle", "upright"}
    for name in first:
        assert np.array_equal(first[name].X_WPs, again[name].X_WPs)
        assert np.array_equal(first[name].scores, again[name].scores)
        assert not np.allclose(first[name].X_WPs, other[name].X_WPs)


def test_pose_sets_are_those_asked_for_and_inside_the_workspace(network: SplitNetwork) -> None:
    wanted = (UPRIGHT, GRASP)
    found = detector_of(network).detect(make_scene(), wanted, np.random.default_rng(0))
    assert tuple(found) == ("upright", "grasp")
    for task, pose_set in zip(wanted, found.values(), strict=True):
        assert pose_set.task == task
        assert len(pose_set) == SAMPLER.samples
        p_VPs = pose_set.X_WPs[:, :3, 3] - Workspace().p_WV
        assert p_VPs.min() > -1e-6
        assert p_VPs.max() < Workspace().edge_m + 1e-6


def test_tasks_may_be_asked_for_by_their_names(network: SplitNetwork) -> None:
    detector = detector_of(network)
    by_name, by_value = (
        detector.detect(make_scene(), tasks, np.random.default_rng(0))
        for tasks in (("handle", "upright"), MUG_TASKS[1:])
    )
    assert tuple(by_name) == tuple(by_value) == ("handle", "upright")
    for name in by_name:
        assert by_name[name].task == by_value[name].task
        assert np.array_equal(by_name[name].X_WPs, by_value[name].X_WPs)
    assert detector.detect(make_scene(), (), np.random.default_rng(0)) == {}


def test_a_task_that_the_network_does_not_know_is_an_error(network: SplitNetwork) -> None:
    detector, rng = detector_of(network), np.random.default_rng(0)
    message = "the checkpoint has no task 'lid'; it has grasp, handle, upright"
    for ask in (detector.detect, detector.sample):
        with pytest.raises(UnknownTaskError, match=message):
            ask(make_scene(), (GRASP, LID), rng)
    unlike = replace(UPRIGHT, symmetry=Symmetry.any_turn("z"))
    with pytest.raises(UnknownTaskError, match=r"'upright' has the symmetry .*'any turn'"):
        detector.detect(make_scene(), (unlike,), rng)


def test_poses_follow_a_workspace_that_stands_elsewhere(network: SplitNetwork) -> None:
    detector = detector_of(network)
    elsewhere = Workspace(p_WCenter=(-0.2, 0.7, 0.3))
    here, there = (
        detector.detect(make_scene(workspace), (GRASP,), np.random.default_rng(0))["grasp"]
        for workspace in (Workspace(), elsewhere)
    )
    shift = elsewhere.p_WV - Workspace().p_WV
    assert np.allclose(here.X_WPs[:, :3, 3] + shift, there.X_WPs[:, :3, 3], atol=2e-4)


def test_a_workspace_of_another_size_is_an_error(network: SplitNetwork) -> None:
    scene = make_scene(Workspace(edge_m=0.4))
    with pytest.raises(ValueError, match=r"0\.4.*trained for \(0\.3"):
        detector_of(network).detect(scene, MUG_TASKS, np.random.default_rng(0))
    other_table = Workspace(table_clearance_m=0.01)
    with pytest.raises(ValueError, match=r"trained for \(0\.3, 0\.05, 0\.01"):
        detector_of(network, workspace=other_table).detect(
            make_scene(), MUG_TASKS, np.random.default_rng(0)
        )


def test_poses_with_lower_scores_are_rejected(network: SplitNetwork) -> None:
    scene, rng = make_scene(), np.random.default_rng(0)
    drawn = detector_of(network).sample(scene, (GRASP,), rng)["grasp"].scores
    scores = np.round(drawn, 3)  # as they are where they are compared
    threshold = float(np.median(scores))
    config = replace(SAMPLER, acceptance=Acceptance(threshold, threshold))
    detector = detector_of(network, config)
    kept = detector.detect(scene, (GRASP,), np.random.default_rng(0))["grasp"]
    assert detector.acceptance == config.acceptance
    assert len(kept) == np.count_nonzero(scores >= threshold)
    assert 0 < len(kept) < len(scores)
    assert kept.scores.min() >= threshold


def test_all_rejected_gives_an_empty_pose_set(network: SplitNetwork) -> None:
    config = replace(SAMPLER, acceptance=Acceptance(0.999, 0.999))
    found = detector_of(network, config).detect(make_scene(), MUG_TASKS, np.random.default_rng(0))
    assert {name: len(pose_set) for name, pose_set in found.items()} == {
        "grasp": 0,
        "handle": 0,
        "upright": 0,
    }


def stand_still(process: ReverseDiffusion, X: Tensor) -> Tensor:
    """Integrate nothing."""
    return X


def test_an_integrator_takes_the_place_of_the_dynamics(network: SplitNetwork) -> None:
    starts: list[np.ndarray] = []
    detector = SplitDetector(network, Workspace(), SAMPLER, integrator=stand_still)
    samples = detector.sample(make_scene(), (GRASP,), np.random.default_rng(0))
    detector_of(network).sample(
        make_scene(),
        (GRASP,),
        np.random.default_rng(0),
        callback=lambda step, X_VPs: starts.append(X_VPs.numpy().copy()),
    )
    p_WPs = starts[0][0, :, :3, 3] + Workspace().p_WV
    assert np.allclose(samples["grasp"].X_WPs[:, :3, 3], p_WPs)
    assert len(starts) == SAMPLER.langevin.steps + SAMPLER.langevin.final_steps + 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SamplerConfig(samples=0), "samples is 0; expected at least 1"),
    ],
)
def test_impossible_sampler_options_are_errors(
    make: Callable[[], SamplerConfig], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def info_of(network: SplitNetwork) -> CheckpointInfo:
    """Return where a network is said to come from."""
    return CheckpointInfo(
        config=network.config,
        tasks=network.tasks,
        workspace=Workspace(p_WCenter=(0.4, 0.1, 0.2)),
        training={"minutes": 1.0},
        seed=3,
        dataset_hash="d4ta",
        commit="c0ffee",
        steps=10,
        scenes=80,
        metrics={"grasp": 0.5},
    )


@pytest.fixture
def checkpoint(tmp_path: Path, network: SplitNetwork) -> Path:
    path = tmp_path / "split.safetensors"
    save_checkpoint(path, network, info_of(network))
    return path


def test_checkpoint_rebuilds_network_and_provenance(
    checkpoint: Path, network: SplitNetwork
) -> None:
    loaded, info = load_checkpoint(checkpoint)
    assert info == info_of(network)
    assert (info.seed, info.dataset_hash, info.commit) == (3, "d4ta", "c0ffee")
    assert (info.steps, info.scenes, info.metrics) == (10, 80, {"grasp": 0.5})
    assert not loaded.training
    poses = [
        detector_of(n).detect(make_scene(), MUG_TASKS, np.random.default_rng(0))
        for n in (network, loaded)
    ]
    for name in poses[0]:
        assert np.array_equal(poses[0][name].X_WPs, poses[1][name].X_WPs)


def test_a_checkpoint_brings_its_tasks_and_its_workspace(
    tmp_path: Path, network: SplitNetwork
) -> None:
    path, workspace = tmp_path / "lids.safetensors", Workspace(edge_m=0.4)
    torch.manual_seed(0)
    lids = SplitNetwork(replace(network.config, edge_m=0.4), (LID, GRASP))
    save_checkpoint(path, lids, replace(info_of(lids), workspace=workspace))
    detector = SplitDetector.from_checkpoint(path, SAMPLER)
    assert (detector.tasks, detector.workspace) == ((LID, GRASP), workspace)
    found = detector.detect(make_scene(workspace), ("lid",), np.random.default_rng(0))
    assert found["lid"].task == LID
    assert len(found["lid"]) == SAMPLER.samples


def test_provenance_of_another_network_is_not_written(
    tmp_path: Path, network: SplitNetwork
) -> None:
    path = tmp_path / "split.safetensors"
    with pytest.raises(ValueError, match="info describes"):
        save_checkpoint(path, network, replace(info_of(network), tasks=(GRASP,)))
    assert not path.exists()


def test_missing_checkpoint_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"absent\.safetensors does not exist"):
        load_checkpoint(tmp_path / "absent.safetensors")


def test_damaged_checkpoint_is_an_error(checkpoint: Path) -> None:
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    with pytest.raises(CheckpointError, match="damaged"):
        load_checkpoint(checkpoint)


def rewrite(path: Path, metadata: dict[str, str]) -> None:
    """Write the tensors in `path` back with other metadata, of which the checksum is right."""
    tensors = load_file(path)
    save_file(tensors, path, metadata | {CHECKSUM: content_sha256(metadata, tensors)})


def test_foreign_checkpoint_is_an_error(checkpoint: Path) -> None:
    rewrite(checkpoint, {"format": "pt"})
    with pytest.raises(CheckpointError, match=r"format 'pt'; expected 'split_drake\.split'"):
        load_checkpoint(checkpoint)


def test_checkpoint_of_another_version_is_an_error(checkpoint: Path) -> None:
    rewrite(checkpoint, {"format": "split_drake.split", "format_version": "99"})
    with pytest.raises(CheckpointError, match="version 99; this code reads version 1"):
        load_checkpoint(checkpoint)


def test_weights_of_another_architecture_are_an_error(checkpoint: Path) -> None:
    _, info = load_checkpoint(checkpoint)
    config = {"channels": [4, 8, 8], "context_grids": [0, 1, 3], "width": 64, "noise": {}}
    values = {
        "config": config,
        "training": {},
        "seed": info.seed,
        "dataset_hash": "",
        "commit": "",
        "steps": 1,
        "scenes": 8,
    }
    version = {"format": "split_drake.split", "format_version": "1"}
    rewrite(checkpoint, version | {"info": json.dumps(values)})
    with pytest.raises(CheckpointError, match="does not describe the network it holds"):
        load_checkpoint(checkpoint)
    values["config"] = config | {"widht": 3}
    rewrite(checkpoint, version | {"info": json.dumps(values)})
    with pytest.raises(CheckpointError, match="widht"):
        load_checkpoint(checkpoint)


@pytest.mark.parametrize(
    "info", ["null", '"x"', "3", '{"config": null}', "{}", '{"config": []}', "{"]
)
def test_malformed_provenance_is_an_error(checkpoint: Path, info: str) -> None:
    rewrite(checkpoint, {"format": "split_drake.split", "format_version": "1", "info": info})
    with pytest.raises(CheckpointError, match="does not describe the network it holds"):
        load_checkpoint(checkpoint)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_neither_loaded_nor_saved(
    checkpoint: Path, value: float
) -> None:
    network, info = load_checkpoint(checkpoint)
    tensors = load_file(checkpoint)
    with safe_open(checkpoint, framework="pt") as file:
        metadata = file.metadata()
    tensors["score_head.output.bias"][2] = value
    save_file(tensors, checkpoint)
    rewrite(checkpoint, metadata)
    with pytest.raises(CheckpointError, match=r"1 of \d+ tensors .* score_head\.output\.bias"):
        load_checkpoint(checkpoint)
    network.get_buffer("encoder.blocks.0.reduce.1.running_var")[0] = value
    before = checkpoint.read_bytes()
    with pytest.raises(CheckpointError, match=r"running_var among them"):
        save_checkpoint(checkpoint, network, info)
    assert checkpoint.read_bytes() == before
    assert [path.name for path in checkpoint.parent.iterdir()] == [checkpoint.name]


def test_where_a_network_comes_from_is_kept(checkpoint: Path, network: SplitNetwork) -> None:
    _, info = load_checkpoint(checkpoint)
    assert (info.earlier_commits, info.parent) == ((), None)
    further = replace(info, earlier_commits=("f00d",), parent={"sha256": "ab", "steps": 3})
    save_checkpoint(checkpoint, network, further)
    assert load_checkpoint(checkpoint)[1] == further


def test_thorough_detectors_are_the_long_sampler_and_a_widened_one_is_warmer(
    network: SplitNetwork,
) -> None:
    detector = detector_of(network, SamplerConfig(samples=7))
    assert detector.thorough().config == replace(SIXTEEN_EVALUATIONS, samples=7)
    wide = detector.widened()
    langevin = replace(SIXTEEN_EVALUATIONS.langevin, temperature=WIDE_TEMPERATURE)
    assert wide.config == replace(SIXTEEN_EVALUATIONS, samples=7, langevin=langevin)


def test_the_scenes_of_all_ancestors_are_counted(checkpoint: Path) -> None:
    _, info = load_checkpoint(checkpoint)
    grandparent = {"scenes": 4, "parent": None}
    info = replace(info, scenes=2, parent={"scenes": 3, "parent": grandparent})
    assert info.scenes_in_all == 9


def test_the_weights_of_the_project_are_usable_small_and_documented() -> None:
    assert default_weights().stat().st_size <= 20e6
    network, info = load_checkpoint(default_weights())
    assert info.config == SplitConfig() == network.config
    assert (info.tasks, info.workspace) == (MUG_TASKS, FIRST_WORKSPACE)
    assert re.fullmatch(r"[0-9a-f]{64}", info.dataset_hash)
    assert re.match(r"[0-9a-f]{40}", info.commit)
    assert info.steps > 0


def test_the_weights_of_the_project_tell_what_they_reached() -> None:
    """On other mugs than they were trained on."""
    _, info = load_checkpoint(default_weights())
    assert info.metrics, "not evaluated: training.evaluate --ship records the metrics"
    assert info.metrics["mugs"] == "test"
    assert not info.commit.endswith("-dirty")
    for task in MUG_TASKS:
        assert info.metrics[task.name]["top_good"]["all"]["share"] > 0.9


def test_a_checkpoint_that_does_not_say_its_workspace_has_that_of_its_grid(
    checkpoint: Path, tmp_path: Path
) -> None:
    network, info = load_checkpoint(checkpoint)
    config = replace(network.config, edge_m=0.4, table_m=0.1)
    larger = SplitNetwork(config, network.tasks)
    workspace = Workspace(edge_m=0.4, depth_below_m=0.1)
    path = tmp_path / "larger.safetensors"
    save_checkpoint(path, larger, replace(info, config=config, workspace=workspace))
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
    old = json.loads(metadata["info"])
    del old["workspace"], old["tasks"]
    rewrite(path, metadata | {"info": json.dumps(old)})
    assert load_checkpoint(path)[1].workspace == replace(
        FIRST_WORKSPACE, edge_m=0.4, depth_below_m=0.1
    )


def test_a_workspace_that_is_not_the_grids_cube_is_refused(
    checkpoint: Path, network: SplitNetwork
) -> None:
    _, info = load_checkpoint(checkpoint)
    other = replace(info.workspace, edge_m=2.0)
    message = r"edge_m=.* the workspace has edge_m=2\.0 .*expected the same"
    with pytest.raises(ValueError, match=message):
        save_checkpoint(checkpoint, network, replace(info, workspace=other))
    with pytest.raises(ValueError, match=message):
        SplitDetector(network, other)


def test_the_weights_for_clutter_know_grasps_and_come_from_those_for_mugs() -> None:
    path = default_weights().with_name("split_clutter.safetensors")
    assert path.stat().st_size <= 20e6
    network, info = load_checkpoint(path)
    assert (network.tasks, info.workspace) == ((GRASP,), Workspace())
    ancestors, parent = list[str](), info.parent
    while parent is not None:
        ancestors.append(parent["sha256"])
        parent = parent["parent"]
    assert known_hashes(default_weights()).intersection(ancestors)
    assert not info.commit.endswith("-dirty")
