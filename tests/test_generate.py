"""Scene generation: contents of a shard, resuming, determinism, and reading back."""

import json
from pathlib import Path

import numpy as np
import pytest

from split_drake.data import generate as generate_module
from split_drake.data.dataset import ARRAYS, MANIFEST, DatasetError, MugDataset
from split_drake.data.generate import GenerateConfig, generate, handle_points, write_shard
from split_drake.data.grasps import check_grasps
from split_drake.data.mugs import load_mug, mug_names, mug_parameters
from split_drake.poses import check_poses, invert_pose, make_pose
from split_drake.scene import Workspace

NAMES = ("test_002", "test_007")
SCENES = 3


@pytest.fixture(scope="module")
def few_mugs() -> pytest.MonkeyPatch:
    """Limit the split to two mugs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generate_module, "mug_names", lambda split: NAMES)
        yield patch


def config(out: Path, **changes: int) -> GenerateConfig:
    options = {"scenes_per_mug": SCENES, "workers": 1} | changes
    return GenerateConfig(out=out, mugs="test", **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, few_mugs: pytest.MonkeyPatch) -> Path:
    path = tmp_path_factory.mktemp("dataset")
    generate(config(path))
    return path


@pytest.fixture(scope="module")
def dataset(folder: Path) -> MugDataset:
    return MugDataset.open(folder)


def test_dataset_has_all_scenes(dataset: MugDataset) -> None:
    count = SCENES * len(NAMES)
    assert len(dataset) == count
    assert dataset.mug_names == NAMES
    assert dataset.mug_index.tolist() == [0] * SCENES + [1] * SCENES
    shapes = {name: getattr(dataset, name).shape for name in ARRAYS}
    assert shapes == {
        "clouds": (count, 2000, 3),
        "X_WOs": (count, 4, 4),
        "grasps": (count, 128, 4, 4),
        "grasp_negatives": (count, 64, 4, 4),
        "handles": (count, 2, 4, 4),
        "uprights": (count, 1, 4, 4),
        "handle_points": (count,),
    }
    assert dataset.clouds.dtype == np.float32
    assert dataset.handle_points.dtype == np.int32
    for name in ("X_WOs", "grasps", "grasp_negatives", "handles", "uprights"):
        check_poses(getattr(dataset, name), name)


def test_clouds_lie_on_the_mug_where_it_stands(dataset: MugDataset) -> None:
    for index, cloud in zip(dataset.mug_index, dataset.clouds, strict=True):
        assert Workspace().contains(cloud.astype(float)).all()
        lower, upper = load_mug(NAMES[index]).body.mesh.bounds
        extent = np.linalg.norm(upper - lower)
        assert np.linalg.norm(np.ptp(cloud, axis=0)) < extent * 1.5


def test_labels_belong_to_the_scene(dataset: MugDataset) -> None:
    for scene in (0, SCENES):
        mug = load_mug(NAMES[dataset.mug_index[scene]])
        X_WO = dataset.X_WOs[scene].astype(float)
        assert np.allclose(dataset.handles[scene], mug.handle_poses(X_WO), atol=1e-6)
        assert np.allclose(dataset.uprights[scene], X_WO[None], atol=1e-6)
        X_OWs = invert_pose(X_WO)
        assert check_grasps(mug, X_OWs @ dataset.grasps[scene]).good.mean() > 0.95
        assert (dataset.grasps[scene][:, 2, 2] < 0.0).all()


def test_handle_points_are_those_outside_the_body() -> None:
    name = mug_names("test")[0]
    parameters, mug = mug_parameters(name), load_mug(name)
    X_WO = make_pose(p=(0.5, 0.1, 0.0))
    p_OHandle = mug.opening_OPs[mug.opening_OPs[:, 0] > mug.X_OH[0, 3]]
    p_OBody = np.array([[0.0, 0.0, 0.01], [-parameters.outer_radius_m * 0.5, 0.0, 0.03]])
    p_WPs = np.vstack([p_OHandle, p_OBody]) + X_WO[:3, 3]
    assert handle_points(parameters, X_WO, p_WPs) == len(p_OHandle)


def test_finished_shards_are_kept_and_missing_ones_come_out_the_same(
    folder: Path, dataset: MugDataset, few_mugs: pytest.MonkeyPatch
) -> None:
    kept, lost = (folder / f"{name}.npz" for name in NAMES)
    before = kept.stat().st_mtime_ns
    lost.unlink()
    (folder / MANIFEST).unlink()
    generate(config(folder))
    assert kept.stat().st_mtime_ns == before
    assert MugDataset.open(folder).dataset_hash == dataset.dataset_hash


def test_a_shard_depends_on_seed_and_mug_only(folder: Path, tmp_path: Path) -> None:
    write_shard(config(tmp_path, scenes_per_mug=1), NAMES[1])
    write_shard(config(tmp_path / ".." / tmp_path.name, seed=1, scenes_per_mug=1), NAMES[0])
    with np.load(folder / f"{NAMES[1]}.npz") as full, np.load(tmp_path / f"{NAMES[1]}.npz") as one:
        assert np.array_equal(full["clouds"][:1], one["clouds"])
    with np.load(folder / f"{NAMES[0]}.npz") as full, np.load(tmp_path / f"{NAMES[0]}.npz") as one:
        assert not np.array_equal(full["X_WOs"][:1], one["X_WOs"])


def test_a_mug_that_nothing_can_grasp_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        generate_module, "feasible", lambda X_WO, X_OGs, openings_m: np.zeros(len(X_OGs), bool)
    )
    with pytest.raises(DatasetError, match=r"none of 200 resting poses of test_002 leaves 8 of"):
        write_shard(config(tmp_path, scenes_per_mug=1), NAMES[0])
    assert list(tmp_path.iterdir()) == []


def test_another_configuration_is_refused(folder: Path, few_mugs: pytest.MonkeyPatch) -> None:
    with pytest.raises(DatasetError, match=r"asked for .*'seed': 5"):
        generate(config(folder, seed=5))


def test_impossible_options_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="scenes_per_mug is 0; expected at least 1"):
        config(tmp_path, scenes_per_mug=0)


def test_damaged_datasets_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=f"has no {MANIFEST}"):
        MugDataset.open(tmp_path)
    manifest = json.loads((folder / MANIFEST).read_text())
    (tmp_path / MANIFEST).write_text(json.dumps(manifest | {"format_version": 99}))
    with pytest.raises(DatasetError, match="is of format 99"):
        MugDataset.open(tmp_path)
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DatasetError, match=r"test_002\.npz is missing"):
        MugDataset.open(tmp_path)
    for name in NAMES:
        (tmp_path / f"{name}.npz").write_bytes((folder / f"{name}.npz").read_bytes()[:-1] + b"x")
    with pytest.raises(DatasetError, match="has changed: SHA-256"):
        MugDataset.open(tmp_path)
