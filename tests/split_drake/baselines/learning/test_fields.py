"""Fields, occupancy and widths of scenes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from split_drake.baselines.learning.draw_fields import FieldOptions, draw_shard, recipe_of
from split_drake.baselines.learning.fields import SceneFields, field_file
from split_drake.baselines.learning.scene_fields import NOISES_M, SceneSolid, noisy_fields
from split_drake.baselines.learning.volume_lessons import VolumeScenes
from split_drake.baselines.palm_frame import grippers_of_palms
from split_drake.data.clutter.scenes import ClutterScene
from split_drake.data.dataset import DatasetError, SceneDataset
from split_drake.experiments.run import AnotherRunError
from split_drake.poses import invert_pose, make_pose, transform_points
from split_drake.scene import Workspace
from tests.split_drake.baselines.learning.conftest import SCENES, Lesson
from tests.split_drake.data.clutter.conftest import BODIES


def test_a_solid_knows_what_lies_within(scenes: list[ClutterScene]) -> None:
    for each in scenes:
        solid, rng = SceneSolid(each), np.random.default_rng(0)
        p_WPs = rng.uniform((0.34, -0.16, -0.16), (0.66, 0.16, 0.16), (3000, 3))
        expected = np.zeros(len(p_WPs), bool)
        for thing, X_WO in zip(each.objects, each.X_WOs, strict=True):
            p_OPs = transform_points(invert_pose(X_WO), p_WPs)
            low, high = thing.body.mesh.bounds
            within = np.all((p_OPs > low) & (p_OPs < high), axis=1)
            if thing.body.name == "can":
                within &= np.hypot(p_OPs[:, 0], p_OPs[:, 1]) < 0.025
            expected |= within
        assert expected.any()
        # The can's mesh has facets.
        assert (solid.holds(p_WPs) != expected).mean() < 2e-3


def test_widths_are_those_of_what_is_pinched(scenes: list[ClutterScene]) -> None:
    whole = next(each for each in scenes if any(thing.body.name == "bar" for thing in each.objects))
    bar = [thing.body.name for thing in whole.objects].index("bar")
    alone = replace(whole, objects=(whole.objects[bar],), X_WOs=whole.X_WOs[bar : bar + 1])
    across = make_pose(np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]], float), (0.0, 0.0, 0.0))
    beside = make_pose(across[:3, :3], (0.0, 0.0, 0.5))
    X_WO = alone.X_WOs[0]
    found = SceneSolid(alone).widths(np.stack([X_WO @ across, X_WO @ beside]))
    size = np.ptp(BODIES["bar"].mesh.bounds, axis=0)
    scale = np.ptp(alone.objects[0].body.mesh.bounds, axis=0) / size
    assert found[0] == pytest.approx(0.04 * scale[0], abs=1e-5)
    assert found[1] == 0.0


def test_noise_moves_the_surface_of_a_field(scenes: list[ClutterScene]) -> None:
    found = noisy_fields(scenes[0], np.random.default_rng(0))
    assert found.shape == (len(NOISES_M), 40, 40, 40) and found.dtype == np.uint8
    clean, *noisy = found.astype(float)
    assert (clean == noisy_fields(scenes[0], np.random.default_rng(1))[0]).all()
    both = (clean > 0) & (noisy[0] > 0)
    # 5 mm of noise along the ray, of a truncation of 30 mm each way.
    assert 0.5 < (clean - noisy[0])[both].std() / (255 * 5.0 / 60.0) < 1.5
    assert (noisy[0] != noisy[1]).any()


def test_fields_are_those_of_the_datasets_scenes(lesson: Lesson, tmp_path: Path) -> None:
    dataset = SceneDataset.open(lesson.data)
    kept = SceneFields.open(lesson.fields, dataset.shard_names, dataset.dataset_hash)
    assert len(kept.fields) == len(dataset) == SCENES
    scenes = VolumeScenes.of(dataset, lesson.fields)
    generator = torch.Generator().manual_seed(0)
    palms = scenes.draw(torch.arange(SCENES), generator)
    true = (palms.label * palms.counted).bool()
    voxel_m = dataset.workspace.edge_m / 40
    labels = dataset.labels["grasp"]
    for scene in range(SCENES):
        p_VTs = palms.voxels[scene][true[scene]].numpy() * voxel_m
        q = palms.quaternion_xyzw[scene][true[scene]].numpy()
        X_WGs = grippers_of_palms(_poses(q, p_VTs + dataset.workspace.p_WV))
        known = labels.X_OPs[scene][labels.states[scene] == 1]
        nearest = np.abs(X_WGs[:, None] - known[None]).max(axis=(2, 3)).min(axis=1)
        assert nearest.max() < 1e-4
    widths = palms.width_voxels[true].numpy() * voxel_m
    assert (widths > 0.005).all() and (widths < 0.08).all()
    points, inside = scenes.draw_points(torch.arange(SCENES), 4096, generator)
    assert 0.0 < inside.mean() < 0.2
    # Objects of piles sink into the table by millimetres.
    lowest_m = points[..., 2][inside.bool()].min() * voxel_m - dataset.workspace.depth_below_m
    assert lowest_m > -0.005


def _poses(quaternion_xyzw: np.ndarray, p: np.ndarray) -> np.ndarray:
    return make_pose(Rotation.from_quat(quaternion_xyzw).as_matrix(), p)


def test_fields_of_other_scenes_are_refused(lesson: Lesson, tmp_path: Path) -> None:
    dataset = SceneDataset.open(lesson.data)
    other = replace(lesson.recipe, seed=7)
    with pytest.raises(DatasetError, match="has other scenes than are drawn of its seed now"):
        draw_shard(other, lesson.data, tmp_path, "clutter_00000")
    with pytest.raises(DatasetError, match=r"holds the fields of .*; expected those of abc"):
        SceneFields.open(lesson.fields, dataset.shard_names, "abc")
    with pytest.raises(DatasetError, match=r"has no config.json; expected a folder of"):
        SceneFields.open(tmp_path, dataset.shard_names, dataset.dataset_hash)
    (tmp_path / "config.json").write_text(json.dumps({"dataset_hash": dataset.dataset_hash}))
    np.savez(field_file(tmp_path, "clutter_00000"), fields=np.zeros((1, 3, 8, 8, 8), np.uint8))
    with pytest.raises(ValueError, match="holds fields, but no 'p_VPs'"):
        SceneFields.open(tmp_path, dataset.shard_names, dataset.dataset_hash)
    with pytest.raises(AnotherRunError, match="objects was 'blocks'"):
        recipe_of(FieldOptions(lesson.data, lesson.recipe.library, tmp_path))
    assert Workspace() == dataset.workspace
