"""Training batches, losses, and the trainer: what a step does, and going on from a saved state."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from helpers_training import BATCH, NETWORK, OPTIMIZER, scenes_on_cpu

from split_drake.pose_set import PoseTask
from split_drake.poses import invert_pose
from split_drake.scene import Workspace, occupancy_grid
from split_drake.split.diffusion import displacement, move
from split_drake.split.network import TASKS, SplitConfig
from split_drake.training import batches, losses, trainer


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


def test_a_skipped_step_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    """The statistics of the batch norms are moved by the forward pass, before a step is skipped."""
    engine = trainer.Trainer(scenes_on_cpu(), NETWORK, BATCH, OPTIMIZER, seed=0, bfloat16=False)
    engine.take_step(0.0)
    before = {name: value.clone() for name, value in engine.network.state_dict().items()}
    with monkeypatch.context() as patch:
        patch.setattr(trainer, "draw_batch", draw_batch_of_nan)
        skipped = engine.take_step(0.0)
    assert not torch.isfinite(skipped.total)
    for name, value in engine.network.state_dict().items():
        assert torch.equal(value, before[name]), name
    assert torch.isfinite(engine.take_step(0.0).total)
    for name, value in engine.average.state_dict().items():
        assert torch.isfinite(value).all(), name


def draw_batch_of_nan(*args: Any) -> batches.TrainingBatch:
    """Return a batch whose voxels are not finite."""
    batch = batches.draw_batch(*args)
    return replace(batch, occupied=torch.full(batch.occupied.shape, torch.nan))


def test_skipped_steps_are_counted_across_an_interruption(tmp_path: Path) -> None:
    first, second = (
        trainer.Trainer(scenes_on_cpu(), NETWORK, BATCH, OPTIMIZER, seed=0, bfloat16=False)
        for _ in range(2)
    )
    with torch.no_grad():
        first.network.score_head.output.bias.fill_(float("nan"))
    for _ in range(OPTIMIZER.tolerated_steps):
        first.take_step(0.0)
    first.save(tmp_path / "state.pt")
    second.restore(tmp_path / "state.pt")
    with pytest.raises(trainer.TrainingDivergedError, match="4 steps in a row"):
        second.take_step(0.0)


def test_states_that_cannot_be_used_are_errors(tmp_path: Path) -> None:
    engine = trainer.Trainer(scenes_on_cpu(), NETWORK, BATCH, OPTIMIZER, seed=0, bfloat16=False)
    path = tmp_path / "state.pt"
    engine.save(path)
    state = torch.load(path)
    # A CUDA generator's state has 16 bytes, a CPU's 5056.
    torch.save(state | {"generator": torch.zeros(16, dtype=torch.uint8)}, path)
    with pytest.raises(trainer.StateError, match="another type of device"):
        engine.restore(path)
    torch.save({"network": {}}, path)
    with pytest.raises(trainer.StateError, match="is no state of a run; expected adam, average"):
        engine.restore(path)
    torch.save(state, path)
    for damaged in (path.read_bytes()[:-1000], b"", b"not a state"):
        path.write_bytes(damaged)
        with pytest.raises(trainer.StateError, match="is damaged"):
            engine.restore(path)


def test_an_interrupted_run_ends_where_an_uninterrupted_one_does(tmp_path: Path) -> None:
    scenes, args = scenes_on_cpu(), (NETWORK, BATCH, OPTIMIZER)
    whole = trainer.Trainer(scenes, *args, seed=0, bfloat16=False)
    for _ in range(6):
        whole.take_step(0.5)
    first = trainer.Trainer(scenes, *args, seed=0, bfloat16=False)
    for _ in range(3):
        first.take_step(0.5)
    state = tmp_path / "state.pt"
    first.save(state)
    second = trainer.Trainer(scenes, *args, seed=7, bfloat16=False)
    second.restore(state)
    for _ in range(3):
        second.take_step(0.5)
    assert second.step == 6
    for name, value in whole.average.state_dict().items():
        assert torch.allclose(value, second.average.state_dict()[name], atol=1e-5), name
