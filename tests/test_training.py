"""Training: batches, losses, and runs that learn, stop, and go on."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from split_drake.pose_set import PoseTask
from split_drake.poses import invert_pose, make_pose, rotation_z
from split_drake.scene import Workspace, occupancy_grid
from split_drake.split.checkpoint import load_checkpoint
from split_drake.split.diffusion import displacement, move
from split_drake.split.network import TASKS, SplitConfig
from split_drake.training import batches, losses, trainer
from split_drake.training.train import TrainConfig, train

NETWORK = SplitConfig(channels=(4, 8, 8), context_grids=(0, 1, 3), width=32, layers=4)
BATCH = batches.BatchConfig(scenes=4, grasps=8, handles=8, uprights=8, negatives=4)
OPTIMIZER = trainer.OptimizerConfig(learning_rate=3e-3, warmup_steps=5)


@dataclass(frozen=True)
class PostScenes:
    """Scenes of a post with a knob on one side: its top is grasped, its foot stood on the table."""

    clouds: np.ndarray
    grasps: np.ndarray
    grasp_negatives: np.ndarray
    handles: np.ndarray
    uprights: np.ndarray
    dataset_hash: str = "post"


def make_scenes(count: int = 12) -> PostScenes:
    """Return posts 10 cm high at random places of the default workspace, in W."""
    rng = np.random.default_rng(0)
    yaw = rng.uniform(0.0, 2.0 * np.pi, count)
    p_WO = np.column_stack([rng.uniform(0.46, 0.54, count), rng.uniform(-0.04, 0.04, count)])
    X_WO = make_pose(
        np.stack([rotation_z(a) for a in yaw]), np.column_stack([p_WO, np.zeros(count)])
    )
    surface = rng.uniform((-0.02, -0.02, 0.005), (0.02, 0.02, 0.1), (2000, 3))
    surface[:200] = rng.uniform((0.02, -0.005, 0.04), (0.05, 0.005, 0.06), (200, 3))
    clouds = surface @ np.swapaxes(X_WO[:, :3, :3], -1, -2) + X_WO[:, None, :3, 3]

    def attach(*positions: tuple[float, float, float]) -> np.ndarray:
        return X_WO[:, None] @ make_pose(p=np.array(positions))

    return PostScenes(
        clouds=clouds.astype(np.float32),
        grasps=attach((0.0, 0.0, 0.1), (0.0, 0.0, 0.08)),
        grasp_negatives=attach((0.0, 0.0, 0.3)),
        handles=attach((0.04, 0.0, 0.05)),
        uprights=attach((0.0, 0.0, 0.0)),
    )


def scenes_on_cpu() -> batches.TrainingScenes:
    """Return the scenes as tensors."""
    cpu = torch.device("cpu")
    return batches.TrainingScenes.from_arrays(make_scenes(), Workspace().p_WV, cpu)


def test_voxels_are_those_of_a_scene() -> None:
    rng = np.random.default_rng(0)
    points = Workspace().p_WV + rng.uniform(-0.02, 0.32, (2, 500, 3))
    grids = batches.voxelize(torch.tensor(points - Workspace().p_WV), SplitConfig())
    for grid, cloud in zip(grids, points, strict=True):
        assert np.array_equal(grid.numpy(), occupancy_grid(cloud, Workspace(), 64))


def test_augmentation_carries_points_and_poses_alike() -> None:
    generator = torch.Generator().manual_seed(0)
    augment = batches.Augmentation.draw(BATCH, NETWORK, generator)
    scenes = scenes_on_cpu()
    points = scenes.p_VSs[: BATCH.scenes]
    X_VUs = scenes.X_VPs[TASKS.index(PoseTask.UPRIGHT)][: BATCH.scenes]
    moved = augment.poses(X_VUs)[:, 0].double().numpy()
    p_USs = in_frames(X_VUs[:, 0].double().numpy(), points)
    after = in_frames(moved, augment.points(points))
    assert np.allclose(after, augment.scale.numpy()[:, None, None] * p_USs, atol=1e-5)
    assert augment.scale.std() > 0.0
    heights_m = moved[:, 2, 3]
    assert np.allclose(heights_m, NETWORK.table_m, atol=1e-6)


def in_frames(X_VUs: np.ndarray, p_VSs: torch.Tensor) -> np.ndarray:
    """Return points (B, N, 3) of V in the frames U (B, 4, 4)."""
    X_UVs = invert_pose(X_VUs)
    return p_VSs.numpy() @ np.swapaxes(X_UVs[:, :3, :3], -1, -2) + X_UVs[:, None, :3, 3]


def test_batches_hold_what_their_description_says() -> None:
    batch = batches.draw_batch(scenes_on_cpu(), BATCH, NETWORK, torch.Generator().manual_seed(0))
    assert batch.occupied.shape == (4, 64, 64, 64)
    assert batch.tasks.tolist() == [0, 0, 1, 1, 2, 2, 0]
    assert batch.X_VPs.shape == (4, 28, 4, 4)
    assert batch.sigma.shape == (4, 6)
    assert batch.target.shape == (4, 6, 4, 6)
    assert batch.label.shape == (4, 7, 4)
    assert batch.occupied.flatten(1).sum(1).min() > 100
    assert NETWORK.noise.sigma_min <= batch.sigma.min() < batch.sigma.max() <= 1.5


def test_labels_follow_the_size_of_the_perturbation() -> None:
    config = replace(BATCH, scenes=64)
    batch = batches.draw_batch(scenes_on_cpu(), config, NETWORK, torch.Generator().manual_seed(0))
    moved = (batch.target * batch.sigma[..., None, None]).square().mean(-1).sqrt()
    limit = 0.03 * 50**0.3
    assert torch.equal(batch.label[:, :6].bool(), moved < limit)
    assert not batch.label[:, 6:].any()
    assert 0.15 < batch.label[:, :6].mean() < 0.45


def test_batches_depend_on_nothing_but_the_generator() -> None:
    first, again = (
        batches.draw_batch(scenes_on_cpu(), BATCH, NETWORK, torch.Generator().manual_seed(5))
        for _ in range(2)
    )
    assert torch.equal(first.X_VPs, again.X_VPs)
    assert torch.equal(first.occupied, again.occupied)
    assert torch.equal(first.target, again.target)


def test_target_points_from_the_noisy_pose_to_a_true_one() -> None:
    """Without augmentation a step along the target ends at a pose of the data set."""
    still = replace(BATCH, shift_m=0.0, scale=0.0, uprights=4)
    scenes = scenes_on_cpu()
    batch = batches.draw_batch(scenes, still, NETWORK, torch.Generator().manual_seed(0))
    noisy = batch.X_VPs[:, : batch.target.shape[1] * 4].unflatten(1, (-1, 4))
    step = batch.sigma[..., None, None] * batch.target
    reached = move(noisy, step, NETWORK.noise.length_m)[:, -1, :, :3, 3]
    assert torch.allclose(reached[..., 2], torch.tensor(NETWORK.table_m), atol=1e-5)
    spread = displacement(noisy[:, -1, :1], noisy[:, -1, 1:2], 0.06).norm(dim=-1)
    assert spread.min() > 1e-3


@pytest.mark.parametrize("counts", [{"grasps": 6}, {"negatives": 0}])
def test_poses_that_do_not_fill_groups_are_an_error(counts: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="multiples of poses_per_sigma=4"):
        batches.BatchConfig(**counts)


def test_focal_loss_is_that_of_its_paper() -> None:
    logits, label = torch.tensor([2.0, 2.0, -1.0]), torch.tensor([1.0, 0.0, 0.0])
    p = torch.sigmoid(logits)
    expected = [
        -0.25 * (1 - p[0]) ** 2 * torch.log(p[0]),
        -0.75 * p[1] ** 2 * torch.log(1 - p[1]),
        -0.75 * p[2] ** 2 * torch.log(1 - p[2]),
    ]
    assert losses.focal_loss(logits, label).item() == pytest.approx(sum(expected).item() / 3)


def test_losses_in_bfloat16_agree_with_float32() -> None:
    scenes = scenes_on_cpu()
    engine = trainer.Trainer(scenes, NETWORK, BATCH, OPTIMIZER, seed=0, bfloat16=False)
    batch = batches.draw_batch(scenes, BATCH, NETWORK, torch.Generator().manual_seed(0))
    exact = losses.compute_losses(engine.network, batch, bfloat16=False)
    coarse = losses.compute_losses(engine.network, batch, bfloat16=True)
    assert coarse.total.item() == pytest.approx(exact.total.item(), rel=0.02)
    assert exact.denoising.tolist() == pytest.approx([1.0, 1.0, 1.0], abs=0.4)


def test_learning_rate_warms_up_holds_and_decays() -> None:
    config = trainer.OptimizerConfig(learning_rate=1.0, warmup_steps=10, hold=0.2, final_rate=0.1)
    assert config.rate(step=0, progress=0.0) == pytest.approx(0.1)
    assert config.rate(step=50, progress=0.2) == pytest.approx(1.0)
    assert config.rate(step=50, progress=0.6) == pytest.approx(0.55)
    assert config.rate(step=50, progress=1.0) == pytest.approx(0.1)


def test_gradients_that_stay_infinite_stop_the_run() -> None:
    engine = trainer.Trainer(scenes_on_cpu(), NETWORK, BATCH, OPTIMIZER, seed=0, bfloat16=False)
    with torch.no_grad():
        engine.network.score_head.output.bias.fill_(float("nan"))
    for _ in range(OPTIMIZER.tolerated_steps):
        engine.take_step(0.0)
    with pytest.raises(trainer.TrainingDivergedError, match="4 steps in a row"):
        engine.take_step(0.0)
    assert torch.isfinite(engine.average.score_head.output.bias).all()


@pytest.fixture
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrainConfig:
    """Return a short run on the posts, which stand in for a data set on disk."""
    monkeypatch.setattr(
        "split_drake.training.train.MugDataset.open", staticmethod(lambda folder: make_scenes())
    )
    return TrainConfig(
        data=tmp_path / "posts",
        out=tmp_path / "run",
        steps=40,
        device="cpu",
        log_steps=10,
        network=NETWORK,
        batch=BATCH,
        optimizer=OPTIMIZER,
    )


def read_curves(folder: Path) -> list[dict[str, float]]:
    """Return the lines of a run's curves."""
    return [json.loads(line) for line in (folder / "curves.jsonl").read_text().splitlines()]


def test_a_run_learns_and_exports_its_weights(options: TrainConfig) -> None:
    train(options)
    curves = read_curves(options.out)
    assert [line["step"] for line in curves] == [10, 20, 30, 40]
    for task in TASKS:
        assert curves[-1][task] < 0.9 * curves[0][task]
    network, info = load_checkpoint(options.out / "split.safetensors")
    assert (info.steps, info.scenes, info.dataset_hash) == (40, 160, "post")
    assert network.config == NETWORK


def test_an_interrupted_run_ends_where_an_uninterrupted_one_does(options: TrainConfig) -> None:
    scenes, args = scenes_on_cpu(), (NETWORK, BATCH, OPTIMIZER)
    whole = trainer.Trainer(scenes, *args, seed=0, bfloat16=False)
    for _ in range(6):
        whole.take_step(0.5)
    first = trainer.Trainer(scenes, *args, seed=0, bfloat16=False)
    for _ in range(3):
        first.take_step(0.5)
    state = options.data.parent / "state.pt"
    first.save(state)
    second = trainer.Trainer(scenes, *args, seed=7, bfloat16=False)
    second.restore(state)
    for _ in range(3):
        second.take_step(0.5)
    assert second.step == 6
    for name, value in whole.average.state_dict().items():
        assert torch.allclose(value, second.average.state_dict()[name], atol=1e-5), name


def test_resuming_continues_the_curves(options: TrainConfig) -> None:
    train(options)
    train(replace(options, resume=True, steps=50))
    assert [line["step"] for line in read_curves(options.out)] == [10, 20, 30, 40, 50]
    with pytest.raises(SystemExit, match="other values of seed;"):
        train(replace(options, resume=True, seed=1))


def test_a_folder_with_a_run_is_not_overwritten(options: TrainConfig) -> None:
    options.out.mkdir()
    (options.out / "config.json").write_text("{}")
    with pytest.raises(SystemExit, match="holds a run"):
        train(options)
    with pytest.raises(SystemExit, match="no run to resume"):
        train(replace(options, resume=True))


def test_a_run_can_start_from_a_checkpoint(options: TrainConfig) -> None:
    train(options)
    further = replace(
        options, out=options.out / "further", init=options.out / "split.safetensors", steps=10
    )
    train(further)
    start, learned = read_curves(options.out)[0], read_curves(further.out)[0]
    assert learned["upright"] < start["upright"]


@pytest.mark.parametrize("length", [{}, {"minutes": 1.0, "steps": 5}])
def test_a_run_has_one_length(length: dict[str, float], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected one of them"):
        TrainConfig(data=tmp_path, out=tmp_path, **length)  # type: ignore[arg-type]
