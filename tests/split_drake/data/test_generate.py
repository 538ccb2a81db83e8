"""Scene generation: contents of a shard, resuming, determinism, and reading back."""

import json
from pathlib import Path

import numpy as np
import pytest

from split_drake.data import generate as generate_module
from split_drake.data import scene_generator
from split_drake.data.dataset import (
    CELLS,
    MANIFEST,
    SHARD_ARRAYS,
    DatasetError,
    MugDataset,
    decode_points,
    encode_points,
    read_shard,
)
from split_drake.data.generate import GenerateConfig, generate, generate_shard
from split_drake.data.grasp_candidates import GraspState
from split_drake.data.randomization import DomainRandomization
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import check_poses
from split_drake.scene import Workspace
from tests.helpers.data import make_checked, make_rests

NAMES = ("test_002", "test_007")
SCENES = 4


@pytest.fixture(scope="module")
def stand_ins() -> pytest.MonkeyPatch:
    """Limit the split to two mugs, the second with fewer grasps, without physics."""
    grasps = {
        name: make_checked(load_mug(name), count)
        for name, count in zip(NAMES, (60, 40), strict=True)
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate_module, "mug_names", lambda split: NAMES)
        patch.setattr(generate_module, "load_checked_grasps", grasps.__getitem__)
        patch.setattr(generate_module, "load_rests", lambda name: make_rests(load_mug(name)))
        patch.setattr(generate_module, "source_hashes", lambda split: {"grasps": "by hand"})
        yield patch


def config(out: Path, **changes: int) -> GenerateConfig:
    options = {"scenes_per_mug": SCENES, "workers": 1} | changes
    return GenerateConfig(out=out, mugs="test", **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, stand_ins: pytest.MonkeyPatch) -> Path:
    path = tmp_path_factory.mktemp("dataset")
    generate(config(path))
    return path


@pytest.fixture(scope="module")
def dataset(folder: Path) -> MugDataset:
    return MugDataset.open(folder)


def test_dataset_has_all_scenes(dataset: MugDataset) -> None:
    scenes, candidates = SCENES * len(NAMES), dataset.X_OGs.shape[1]
    assert len(dataset) == scenes
    assert dataset.mug_names == NAMES
    assert dataset.mug_index.tolist() == [0] * SCENES + [1] * SCENES
    expected = {
        "clouds": ((scenes, 2000, 3), np.float32),
        "X_WOs": ((scenes, 4, 4), np.float32),
        "grasp_states": ((scenes, candidates), np.uint8),
        "handle_points": ((scenes,), np.int32),
        "views": ((scenes,), np.uint8),
        "X_OGs": ((2, candidates, 4, 4), np.float32),
        "qualities": ((2, candidates), np.float32),
        "X_OHs": ((2, 2, 4, 4), np.float32),
        "handles": ((scenes, 2, 4, 4), np.float32),
        "uprights": ((scenes, 1, 4, 4), np.float32),
    }
    arrays = {name: getattr(dataset, name) for name in expected}
    assert {name: (array.shape, array.dtype) for name, array in arrays.items()} == expected
    for name in ("X_WOs", "X_OGs", "handles", "uprights"):
        check_poses(arrays[name], name)


def test_candidates_of_mugs_with_fewer_are_padded(dataset: MugDataset) -> None:
    states = dataset.grasp_states
    padded = states[dataset.mug_index == 1] == GraspState.PADDING
    assert padded.any()
    assert (padded == padded[0]).all()
    assert np.array_equal(dataset.X_OGs[1][padded[0]][0], np.eye(4))
    assert not dataset.qualities[1][padded[0]].any()
    assert not (states[dataset.mug_index == 0] == GraspState.PADDING).any()
    qualities = dataset.qualities[dataset.mug_index]
    true = states == GraspState.TRUE
    assert (true.sum(axis=1) >= 8).all()
    assert (qualities[true] > 0.0).all()
    assert qualities.max() <= 1.0
    assert (states == GraspState.FALSE).any(axis=1).all()


def test_clouds_lie_on_the_mug_where_it_stands(dataset: MugDataset) -> None:
    for index, X_WO, cloud in zip(dataset.mug_index, dataset.X_WOs, dataset.clouds, strict=True):
        mug = load_mug(NAMES[index])
        p_OPs = (cloud - X_WO[:3, 3]) @ X_WO[:3, :3]
        lower, upper = mug.body.mesh.bounds
        near = np.all((p_OPs > lower - 0.01) & (p_OPs < upper + 0.01), axis=1)
        assert near.mean() > 0.15  # Where the table sticks out, it takes most of the points.
    assert np.median([np.ptp(cloud, axis=0).max() for cloud in dataset.clouds]) < 0.2


def test_handles_and_uprights_follow_from_the_pose(dataset: MugDataset) -> None:
    for scene in (0, SCENES):
        mug = load_mug(NAMES[dataset.mug_index[scene]])
        X_WO = dataset.X_WOs[scene].astype(float)
        assert np.allclose(dataset.handles[scene], mug.handle_poses(X_WO), atol=1e-6)
        assert np.array_equal(dataset.uprights[scene, 0], dataset.X_WOs[scene])


def test_points_are_kept_to_a_few_micrometres() -> None:
    workspace = Workspace()
    p_WPs = workspace.p_WV + np.random.default_rng(0).uniform(0.0, workspace.edge_m, (500, 3))
    p_WPs[0] = workspace.p_WV
    p_WPs[1] = workspace.p_WV + workspace.edge_m * (1.0 - 1e-12)
    decoded = decode_points(encode_points(p_WPs, workspace), workspace)
    assert decoded.dtype == np.float32
    assert np.abs(decoded - p_WPs).max() <= workspace.edge_m / CELLS / 2.0 + 1e-7
    with pytest.raises(ValueError, match="outside the workspace"):
        encode_points(p_WPs + 0.01, workspace)


def test_shards_are_small(folder: Path) -> None:
    shard = read_shard(folder / f"{NAMES[0]}.npz")
    of_scenes = ("points", "X_WOs", "grasp_states", "handle_points", "views")
    assert sum(shard[name].nbytes for name in of_scenes) / SCENES < 16_000
    assert set(shard) == set(SHARD_ARRAYS)


def test_the_manifest_says_what_the_scenes_are_like(folder: Path, dataset: MugDataset) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    assert manifest["scenes"] == len(dataset)
    assert manifest["single_view_share"] == pytest.approx((dataset.views == 1).mean())
    hidden = (dataset.handle_points < 30).mean()
    assert manifest["hidden_handle_share"] == pytest.approx(hidden)
    true = (dataset.grasp_states == GraspState.TRUE).sum(axis=1)
    assert manifest["median_true_grasps"] == np.median(true)
    redraws = sum(int(read_shard(folder / f"{name}.npz")["redraws"]) for name in NAMES)
    assert manifest["redraws_for_want_of_grasps"] == redraws
    assert manifest["config"]["sources"] == {"grasps": "by hand"}


def test_finished_shards_are_kept_and_missing_ones_come_out_the_same(
    folder: Path, dataset: MugDataset, stand_ins: pytest.MonkeyPatch
) -> None:
    kept, lost = (folder / f"{name}.npz" for name in NAMES)
    before = kept.stat().st_mtime_ns
    lost.unlink()
    (folder / MANIFEST).unlink()
    generate(config(folder))
    assert kept.stat().st_mtime_ns == before
    assert MugDataset.open(folder).dataset_hash == dataset.dataset_hash


def test_a_shard_depends_on_seed_and_mug_only(
    folder: Path, tmp_path: Path, stand_ins: pytest.MonkeyPatch
) -> None:
    generate_shard(config(tmp_path, scenes_per_mug=1), NAMES[1])
    generate_shard(config(tmp_path, scenes_per_mug=1, seed=1), NAMES[0])
    full, one, other = (
        read_shard(path / f"{name}.npz")
        for path, name in ((folder, NAMES[1]), (tmp_path, NAMES[1]), (tmp_path, NAMES[0]))
    )
    assert np.array_equal(full["points"][:1], one["points"])
    assert np.array_equal(full["X_OGs"], one["X_OGs"])
    assert not np.array_equal(read_shard(folder / f"{NAMES[0]}.npz")["X_WOs"][:1], other["X_WOs"])


def test_scenes_with_too_few_true_grasps_are_drawn_again(
    tmp_path: Path, stand_ins: pytest.MonkeyPatch
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        # Of the few that hold, a scene seldom shows eight.
        patch.setattr(
            generate_module, "load_checked_grasps", lambda name: make_checked(load_mug(name), 16)
        )
        generate_shard(config(tmp_path), NAMES[0])
        shard = read_shard(tmp_path / f"{NAMES[0]}.npz")
        assert shard["redraws"] > 0
        assert ((shard["grasp_states"] == GraspState.TRUE).sum(axis=1) >= 8).all()
        patch.setattr(
            generate_module, "load_checked_grasps", lambda name: make_checked(load_mug(name), 3)
        )
        patch.setattr(scene_generator, "MAX_REDRAWS", 20)
        with pytest.raises(DatasetError, match=r"none of 20 scenes of test_007 leaves 8 of"):
            generate_shard(config(tmp_path), NAMES[1])
    assert [path.name for path in tmp_path.iterdir()] == [f"{NAMES[0]}.npz"]


def test_another_configuration_or_other_sources_are_refused(
    folder: Path, stand_ins: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DatasetError, match=r"asked for .*'seed': 5"):
        generate(config(folder, seed=5))
    changed = GenerateConfig(
        folder, "test", SCENES, randomization=DomainRandomization(edge_loss=0.1), workers=1
    )
    with pytest.raises(DatasetError, match=r"asked for .*'edge_loss': 0\.1"):
        generate(changed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate_module, "source_hashes", lambda split: {"grasps": "new"})
        with pytest.raises(DatasetError, match=r"asked for {'sources': {'grasps': 'new'}}"):
            generate(config(folder))


def test_impossible_options_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="scenes_per_mug is 0; expected at least 1"):
        config(tmp_path, scenes_per_mug=0)


def test_damaged_datasets_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=f"has no {MANIFEST}"):
        MugDataset.open(tmp_path)
    manifest = json.loads((folder / MANIFEST).read_text())
    (tmp_path / MANIFEST).write_text(json.dumps(manifest | {"format_version": 1}))
    with pytest.raises(DatasetError, match="is of format 1; expected 2"):
        MugDataset.open(tmp_path)
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DatasetError, match=r"test_00\d\.npz is missing"):
        MugDataset.open(tmp_path)
    for name in NAMES:
        (tmp_path / f"{name}.npz").write_bytes((folder / f"{name}.npz").read_bytes()[:-1] + b"x")
    with pytest.raises(DatasetError, match="has changed: SHA-256"):
        MugDataset.open(tmp_path)
