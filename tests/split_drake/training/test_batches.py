"""Training batches: augmented alike, drawn by weight and state, labelled by displacement."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
import tyro

from split_drake.data.dataset import TaskLabels
from split_drake.data.labels import PoseState
from split_drake.pose_task import GRASP, HANDLE, MUG_TASKS, UPRIGHT, PoseTask, Symmetry
from split_drake.poses import invert_pose
from split_drake.scene import Workspace, occupancy_grid
from split_drake.split.diffusion import displacement, move
from split_drake.split.network_config import SplitConfig
from split_drake.training import augmentation
from split_drake.training.augmentation import AugmentationConfig, misjudge_range
from split_drake.training.batches import BatchConfig, TrainingBatch, draw_batch
from split_drake.training.training_scenes import TrainingScenes
from tests.helpers.training import (
    BATCH,
    BLOCKED_M,
    FALSE_M,
    FIRM_M,
    LONGER_M,
    NETWORK,
    WEAK_M,
    make_scenes,
    scenes_on_cpu,
)

STILL = AugmentationConfig(shift_m=0.0, scale=0.0, noise_m=(0.0, 0.0))


def seeded(seed: int = 0) -> torch.Generator:
    """Return a generator on the CPU."""
    return torch.Generator().manual_seed(seed)


def draw(config: BatchConfig = BATCH, seed: int = 0) -> TrainingBatch:
    """Return a batch of posts."""
    return draw_batch(scenes_on_cpu(), config, NETWORK, seeded(seed))


def test_voxels_are_those_of_a_scene() -> None:
    rng = np.random.default_rng(0)
    points = Workspace().p_WV + rng.uniform(-0.02, 0.32, (2, 500, 3))
    grids = augmentation.voxelize(torch.tensor(points - Workspace().p_WV), SplitConfig())
    for grid, cloud in zip(grids, points, strict=True):
        assert np.array_equal(grid.numpy(), occupancy_grid(cloud, Workspace(), 64))


def test_similarity_carries_points_and_poses_alike() -> None:
    similarity = augmentation.Similarity.draw(4, AugmentationConfig(), NETWORK, seeded())
    scenes = scenes_on_cpu()
    points, X_VUs = scenes.p_VSs[:4], scenes.X_VOs[:4, None]
    moved = similarity.poses(X_VUs)[:, 0].double().numpy()
    p_USs = in_frames(X_VUs[:, 0].double().numpy(), points)
    after = in_frames(moved, similarity.points(points))
    assert np.allclose(after, similarity.scale.numpy()[:, None, None] * p_USs, atol=1e-5)
    assert similarity.scale.std() > 0.0
    heights_m = moved[:, 2, 3]
    assert np.allclose(heights_m, NETWORK.table_m, atol=1e-6)


def in_frames(X_VUs: np.ndarray, p_VSs: torch.Tensor) -> np.ndarray:
    """Return points (B, N, 3) of V in the frames U (B, 4, 4)."""
    X_UVs = invert_pose(X_VUs)
    return p_VSs.numpy() @ np.swapaxes(X_UVs[:, :3, :3], -1, -2) + X_UVs[:, None, :3, 3]


def test_noise_of_a_scene_has_one_size_and_may_be_next_to_none() -> None:
    clean = torch.zeros(400, 500, 3)
    spread_m = augmentation.add_noise(clean, AugmentationConfig(), seeded()).std((1, 2))
    assert spread_m.min() < 0.0005
    assert 0.0075 < spread_m.max() < 0.0085
    assert spread_m.mean().item() == pytest.approx(0.004, abs=0.0004)


def many_poses() -> torch.Tensor:
    """Return the poses of posts (600, 2, 4, 4), over and over."""
    return scenes_on_cpu().X_VOs[:, None].repeat(50, 2, 1, 1)


def test_half_turns_are_about_the_approach_and_as_frequent_as_not() -> None:
    X = many_poses()
    turned = augmentation.turned_alike(X, GRASP.symmetry, seeded())
    assert torch.equal(turned[..., 2:], X[..., 2:])
    assert torch.allclose(torch.linalg.det(turned[..., :3, :3]), torch.ones(X.shape[:2]))
    along = (turned[..., :3, 0] * X[..., :3, 0]).sum(-1)
    assert torch.allclose(along.abs(), torch.ones(X.shape[:2]))
    assert 0.45 < (along > 0.0).float().mean() < 0.55


def test_any_turns_are_about_the_axis_and_by_any_angle() -> None:
    X = many_poses()
    turned = augmentation.turned_alike(X, Symmetry.any_turn("y"), seeded())
    assert torch.allclose(turned[..., [1, 3]], X[..., [1, 3]], atol=1e-6)
    R_turns = X[..., :3, :3].mT @ turned[..., :3, :3]
    assert torch.allclose(R_turns @ R_turns.mT, torch.eye(3).expand_as(R_turns), atol=1e-5)
    angles = torch.atan2(R_turns[..., 0, 2], R_turns[..., 0, 0])
    quarters = torch.histc(angles, bins=4, min=-torch.pi, max=torch.pi) / angles.numel()
    assert torch.allclose(quarters, torch.full((4,), 0.25), atol=0.05)


def test_poses_that_mean_the_same_as_no_other_are_not_turned() -> None:
    X = many_poses()
    assert torch.equal(augmentation.turned_alike(X, UPRIGHT.symmetry, seeded()), X)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: AugmentationConfig(noise_m=(0.002, 0.001)), "noise_m"),
        (lambda: AugmentationConfig(noise_m=(-0.001, 0.0)), "noise_m"),
        (lambda: AugmentationConfig(scale=1.0), "scale"),
        (lambda: AugmentationConfig(shift_m=-0.01), "shift_m"),
    ],
)
def test_impossible_augmentation_is_an_error(
    make: Callable[[], AugmentationConfig], name: str
) -> None:
    with pytest.raises(ValueError, match=f"{name}.*expected"):
        make()


def heights_above_foot(X_VGs: torch.Tensor, scenes: TrainingScenes) -> np.ndarray:
    """Return the heights (B, N) of grasps above the feet of all posts, to 0.1 mm."""
    return (X_VGs[..., 2, 3] - scenes.X_VOs[:, None, 2, 3]).double().numpy().round(4)


def test_true_grasps_are_drawn_by_weight_where_they_are_true() -> None:
    scenes = scenes_on_cpu()
    drawn = scenes.true_poses(0, torch.arange(12), 4000, seeded())
    heights_m = heights_above_foot(drawn, scenes) - LONGER_M * scenes.object_index[:, None].numpy()
    for scene, found in enumerate(heights_m.round(4)):
        shares = [np.mean(found == height) for height in (FIRM_M, WEAK_M, BLOCKED_M)]
        expected = (0.5, 0.25, 0.25) if scene % 2 == 0 else (2 / 3, 1 / 3, 0.0)
        assert shares == pytest.approx(expected, abs=0.04)
    side = drawn[..., :2, 3] - scenes.X_VOs[:, None, :2, 3]
    assert side.abs().max() < 1e-6


def test_false_grasps_are_those_of_their_scene() -> None:
    scenes = scenes_on_cpu()
    drawn = scenes.false_poses(0, torch.arange(12), 200, seeded())
    heights_m = heights_above_foot(drawn, scenes) - LONGER_M * scenes.object_index[:, None].numpy()
    for scene, found in enumerate(heights_m.round(4)):
        assert set(found) == ({FALSE_M} if scene % 2 == 0 else {FALSE_M, BLOCKED_M})


def scenes_with(task: str, labels: TaskLabels) -> TrainingScenes:
    """Return the scenes of posts with other labels of a task."""
    scenes = make_scenes()
    changed = replace(scenes, labels={**scenes.labels, task: labels})
    return TrainingScenes.of(changed, MUG_TASKS, torch.device("cpu"))


@pytest.mark.parametrize(("state", "kind"), [(1, "true grasp pose"), (2, "false grasp pose")])
def test_scenes_without_true_or_false_grasps_are_an_error(state: int, kind: str) -> None:
    grasps = make_scenes().labels["grasp"]
    states = grasps.states.copy()
    states[5][states[5] == state] = PoseState.PADDING
    with pytest.raises(ValueError, match=f"1 of 12 scenes, 5 the first, have no {kind}"):
        scenes_with("grasp", replace(grasps, states=states))


def test_true_grasps_without_weight_do_not_count() -> None:
    grasps = make_scenes().labels["grasp"]
    with pytest.raises(ValueError, match=r"12 of 12 scenes, 0 the first.*of positive weight"):
        scenes_with("grasp", replace(grasps, weights=np.zeros_like(grasps.weights)))


def test_batches_hold_what_their_description_says() -> None:
    batch = draw()
    assert batch.occupied.shape == (4, 64, 64, 64)
    assert batch.tasks.tolist() == [0, 0, 1, 1, 2, 2, 0]
    assert batch.task_groups == (2, 2, 2)
    assert batch.X_VPs.shape == (4, 28, 4, 4)
    assert batch.sigma.shape == (4, 6)
    assert batch.target.shape == (4, 6, 4, 6)
    assert batch.label.shape == (4, 7, 4)
    assert batch.occupied.flatten(1).sum(1).min() > 100
    assert NETWORK.noise.sigma_min <= batch.sigma.min() < batch.sigma.max() <= 1.5


def test_tasks_may_be_left_out() -> None:
    config = replace(
        BATCH,
        poses_of=(
            ("grasp", 0),
            ("upright", 0),
        ),
        negatives=0,
    )
    batch = draw(config)
    assert config.trained(MUG_TASKS) == (HANDLE,)
    assert [config.count(task) for task in MUG_TASKS] == [0, 8, 0]
    assert (batch.tasks.tolist(), batch.task_groups) == ([1, 1], (2,))
    assert (batch.X_VPs.shape, batch.label.shape) == ((4, 8, 4, 4), (4, 2, 4))


def test_tasks_have_false_poses_only_where_the_scenes_have() -> None:
    handles = draw_batch(scenes_on_cpu((HANDLE,)), BATCH, NETWORK, seeded())
    assert handles.tasks.tolist() == [0, 0]
    turned = np.tile(np.diag([-1.0, -1.0, 1.0, 1.0]).astype(np.float32), (2, 1, 1, 1))
    true = make_scenes().labels["handle"]
    both = TaskLabels(
        X_OPs=np.concatenate([true.X_OPs, true.X_OPs @ turned], axis=1),
        weights=np.array([[1.0, 0.0]] * 2, dtype=np.float32),
        states=np.array([[PoseState.TRUE, PoseState.FALSE]] * 12, dtype=np.uint8),
    )
    batch = draw_batch(scenes_with("handle", both), BATCH, NETWORK, seeded())
    assert batch.tasks.tolist() == [0, 0, 1, 1, 2, 2, 0, 1]
    assert (batch.task_groups, batch.label.shape) == ((2, 2, 2), (4, 8, 4))
    assert not batch.label[:, 6:].any()


def test_a_task_that_has_no_number_of_its_own_has_that_of_all() -> None:
    lid = PoseTask("lid")
    assert [BatchConfig().count(task) for task in (*MUG_TASKS, lid)] == [64, 24, 24, 24]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(BATCH, poses=6), "poses is 6; .* multiple of poses_per_sigma=4"),
        (lambda: replace(BATCH, poses_of=(("grasp", 6),)), "grasp is 6; .* multiple of"),
        (lambda: replace(BATCH, negatives=-4), "negatives is -4; .* multiple of"),
        (lambda: replace(BATCH, scenes=0), "scenes=0"),
        (lambda: replace(BATCH, poses_per_sigma=0), "poses_per_sigma=0; expected 1 or more"),
    ],
)
def test_impossible_counts_are_an_error(make: Callable[[], BatchConfig], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_some_task_must_be_trained() -> None:
    with pytest.raises(ValueError, match="no pose of grasp, handle, upright is trained"):
        replace(BATCH, poses=0).trained(MUG_TASKS)


def test_labels_follow_the_size_of_the_perturbation() -> None:
    batch = draw(replace(BATCH, scenes=64))
    moved = (batch.target * batch.sigma[..., None, None]).square().mean(-1).sqrt()
    limit = 0.03 * 50**0.3
    assert torch.equal(batch.label[:, :6].bool(), moved < limit)
    assert not batch.label[:, 6:].any()
    assert 0.15 < batch.label[:, :6].mean() < 0.45


def test_batches_depend_on_nothing_but_the_generator() -> None:
    first, again, other = draw(seed=5), draw(seed=5), draw(seed=6)
    for name in ("X_VPs", "occupied", "target", "label"):
        assert torch.equal(getattr(first, name), getattr(again, name)), name
        assert not torch.equal(getattr(first, name), getattr(other, name)), name


def test_target_points_from_the_noisy_pose_to_a_true_one() -> None:
    """Without augmentation a step along the target ends at a pose of the data set."""
    batch = draw(replace(BATCH, augmentation=STILL, poses_of=(("upright", 4),)))
    noisy = batch.X_VPs[:, : batch.target.shape[1] * 4].unflatten(1, (-1, 4))
    step = batch.sigma[..., None, None] * batch.target
    reached = move(noisy, step, NETWORK.noise.length_m)[:, -1, :, :3, 3]
    assert torch.allclose(reached[..., 2], torch.tensor(NETWORK.table_m), atol=1e-5)
    spread = displacement(noisy[:, -1, :1], noisy[:, -1, 1:2], 0.06).norm(dim=-1)
    assert spread.min() > 1e-3


def test_a_misjudged_range_moves_points_along_their_rays() -> None:
    points = torch.rand(3, 50, 3, generator=seeded())
    cameras = torch.tensor([[0.15, 0.15, 0.7]] * 3)
    config = AugmentationConfig(range_scale=0.03)
    moved = misjudge_range(points, cameras, config, seeded())
    factors = (moved - cameras[:, None]).norm(dim=-1) / (points - cameras[:, None]).norm(dim=-1)
    assert torch.allclose(factors, factors[:, :1].expand_as(factors), atol=1e-5)
    assert factors[:, 0].std() > 0.001
    assert torch.equal(misjudge_range(points, cameras, AugmentationConfig(), seeded()), points)


def test_poses_of_tasks_that_are_not_there_are_an_error() -> None:
    with pytest.raises(ValueError, match=r"poses_of names 'tpo'; expected one of grasp, handle"):
        replace(BATCH, poses_of=(("tpo", 8),)).trained(MUG_TASKS)


def test_poses_of_a_task_are_set_from_the_command_line() -> None:
    config = tyro.cli(BatchConfig, args=["--poses-of", "grasp", "32", "handle", "8"])
    assert [config.count(task) for task in MUG_TASKS] == [32, 8, 24]
    assert BatchConfig().trained((HANDLE,)) == (HANDLE,)
