"""How objects lie in clutter, what is seen of them, and the datasets that come of it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial import cKDTree

from split_drake.data.clutter import generate as module
from split_drake.data.clutter import scenes as drawing
from split_drake.data.clutter.arrangements import SPREAD_M, Arrangement, packed, subsets
from split_drake.data.clutter.generate import ClutterOptions, generate
from split_drake.data.clutter.library import ClutterObject
from split_drake.data.clutter.piles import PileSimulator
from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScenes
from split_drake.data.clutter.views import ViewRandomization, merged_mesh, see
from split_drake.data.dataset import DatasetError, SceneDataset
from split_drake.data.labels import PoseState
from split_drake.data.object_scenes import NO_FEATURE
from split_drake.experiments.run import AnotherRunError
from split_drake.pose_task import GRASP
from split_drake.poses import transform_points
from split_drake.station.layout import Layout
from split_drake.training.training_scenes import TrainingScenes
from tests.helpers.stations import STATION

WORKSPACE = Layout().workspace


def meshes(objects: Sequence[ClutterObject], arrangement: Arrangement) -> list[trimesh.Trimesh]:
    """Return the mesh of each object where it lies."""
    found = []
    for number, X_WO in zip(arrangement.numbers, arrangement.X_WOs, strict=True):
        mesh = objects[number].body.mesh.copy()
        mesh.apply_transform(X_WO)
        found.append(mesh)
    return found


def test_packed_objects_stand_on_the_table_and_do_not_touch(
    bar: ClutterObject, can: ClutterObject
) -> None:
    objects, counts = [bar, can, bar, can, bar], set[int]()
    for seed in range(10):
        arrangement = packed(objects, WORKSPACE, np.random.default_rng(seed))
        there = meshes(objects, arrangement)
        counts.add(len(there))
        for number, mesh in enumerate(there):
            assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-9)
            assert np.abs(mesh.centroid[:2] - WORKSPACE.p_WCenter[:2]).max() < SPREAD_M + 1e-6
            others = [other for index, other in enumerate(there) if index != number]
            assert not any(other.contains(mesh.sample(200)).any() for other in others)
    assert max(counts) >= 3


def test_an_arrangement_has_been_smaller(bar: ClutterObject) -> None:
    whole = packed([bar] * 4, WORKSPACE, np.random.default_rng(0))
    every = list(subsets(whole))
    assert [len(each.numbers) for each in every] == list(range(1, len(whole.numbers) + 1))
    for before, after in pairwise(every):
        assert np.array_equal(after.X_WOs[: len(before.numbers)], before.X_WOs)


def test_objects_of_a_pile_lie_on_the_table_or_on_each_other(
    bar: ClutterObject, can: ClutterObject
) -> None:
    objects = [bar, can, bar]
    pile = PileSimulator(objects, replace(STATION, time_step_s=0.004))
    arrangements = list(pile.drop_all(np.random.default_rng(1)))
    assert [max(each.numbers) for each in arrangements][-1] >= 1
    for mesh in meshes(objects, arrangements[-1]):
        assert -0.005 < mesh.bounds[0, 2] < 0.1
        assert np.abs(mesh.centroid[:2] - WORKSPACE.p_WCenter[:2]).max() < WORKSPACE.edge_m / 2.0


def test_a_view_is_from_the_side_and_shows_the_surfaces(
    bar: ClutterObject, can: ClutterObject
) -> None:
    objects, config = [bar, can], ViewRandomization()
    arrangement = packed(objects, WORKSPACE, np.random.default_rng(3))
    there = [objects[number] for number in arrangement.numbers]
    points, _ = trimesh.sample.sample_surface(merged_mesh(there, arrangement.X_WOs), 20_000, seed=0)
    surface = cKDTree(points)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scene, p_WC = see(there, arrangement.X_WOs, WORKSPACE, config, rng)
        from_target = p_WC - (*WORKSPACE.p_WCenter[:2], config.target_height_m)
        polar_deg = np.degrees(np.arccos(from_target[2] / np.linalg.norm(from_target)))
        assert 43.0 < polar_deg < 77.0
        distances, _ = surface.query(scene.p_WPs[::10])
        assert np.quantile(distances, 0.9) < 0.006


def test_scenes_are_piled_and_packed_and_all_their_poses_lie_inside(recipe: ClutterRecipe) -> None:
    scenes = list(islice(ClutterScenes(recipe, np.random.default_rng(0)).draw_all(), 8))
    assert len({len(scene.objects) for scene in scenes}) > 1
    for scene in scenes:
        assert len(scene.objects) == len(scene.X_WOs)
        assert len(scene.grasps.X_WGs) >= drawing.LEAST_TRUE
        p_VGs = scene.grasps.X_WGs[:, :3, 3] - WORKSPACE.p_WV
        assert ((p_VGs > 0.0) & (p_VGs < WORKSPACE.edge_m)).all()


@pytest.fixture(scope="module")
def folder(recipe: ClutterRecipe, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clutter")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "SCENES_PER_SHARD", 3)
        generate(recipe, path, shards=2, workers=1)
    return path


def test_a_dataset_of_clutter_is_read_and_trained_on(folder: Path) -> None:
    dataset = SceneDataset.open(folder)
    assert (len(dataset), dataset.tasks, dataset.workspace) == (6, (GRASP,), WORKSPACE)
    assert dataset.object_index.tolist() == [0, 1, 2, 3, 4, 5]
    assert dataset.feature_points.tolist() == [NO_FEATURE] * 6
    scenes = TrainingScenes.of(dataset, (GRASP,), torch.device("cpu"))
    generator = torch.Generator().manual_seed(0)
    X_VGs = scenes.true_poses(0, torch.arange(6), 4, generator).numpy()
    labels = dataset.labels[GRASP.name]
    for number in range(6):
        true = labels.X_OPs[number][labels.states[number] == PoseState.TRUE]
        p_WGs = X_VGs[number, :, :3, 3] + WORKSPACE.p_WV
        distances = np.linalg.norm(p_WGs[:, None] - true[None, :, :3, 3], axis=-1)
        assert distances.min(axis=1).max() < 1e-5


def test_points_of_a_scene_lie_by_its_grasps(folder: Path) -> None:
    dataset = SceneDataset.open(folder)
    labels = dataset.labels[GRASP.name]
    for number in range(len(dataset)):
        true = labels.X_OPs[number][labels.states[number] == PoseState.TRUE]
        p_GPs = transform_points(np.linalg.inv(true[0].astype(float)), dataset.clouds[number])
        assert (np.abs(p_GPs) < (0.015, 0.04, 0.02)).all(axis=1).any()


def test_generation_goes_on_and_depends_on_its_seeds_alone(
    recipe: ClutterRecipe, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SCENES_PER_SHARD", 3)
    first = SceneDataset.open(folder).dataset_hash
    (tmp_path / "again").mkdir()
    generate(recipe, tmp_path / "again", shards=1, workers=1)
    generate(recipe, tmp_path / "again", shards=2, workers=1)
    assert SceneDataset.open(tmp_path / "again").dataset_hash == first
    with pytest.raises(AnotherRunError, match="seed"):
        generate(replace(recipe, seed=1), tmp_path / "again", shards=2, workers=1)


def test_arrangements_that_show_nothing_are_an_error(
    recipe: ClutterRecipe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawing, "LEAST_TRUE", 10_000)
    monkeypatch.setattr(drawing, "MAX_EMPTY", 3)
    with pytest.raises(DatasetError, match="3 arrangements in a row show no grasp"):
        next(ClutterScenes(recipe, np.random.default_rng(0)).draw_all())


def test_impossible_counts_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="scenes is 150; expected a multiple of 200"):
        ClutterOptions(tmp_path, tmp_path, scenes=150)
    with pytest.raises(ValueError, match="workers is 0; expected at least 1"):
        ClutterOptions(tmp_path, tmp_path, workers=0)
