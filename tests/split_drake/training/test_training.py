"""Losses and the trainer: what a step does, and going on from a saved state."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from split_drake.training import batches, losses, trainer
from tests.helpers.training import BATCH, NETWORK, OPTIMIZER, scenes_on_cpu


def test_focal_loss_is_that_of_its_paper() -> None:
    logits, label = torch.tensor([2.0, 2.0, -1.0]), torch.tensor([1.0, 0.0, 0.0])
    p = torch.sigmoid(logits)
    expected = [
        -0.25 * (1 - p[0]) ** 2 * torch.log(p[0]),
        -0.75 * p[1] ** 2 * torch.log(1 - p[1]),
        -0.75 * p[2] ** 2 * torch.log(1 - p[2]),
    ]
    assert losses.focal_loss(logits, label).item() == pytest.approx(
        torch.stack(expected).mean().item()
    )


def test_losses_in_bfloat16_agree_with_float32() -> None:
    scenes = scenes_on_cpu()
    engine = trainer.Trainer(scenes, NETWORK, BATCH, OPTIMIZER, seed=0, bfloat16=False)
    batch = batches.draw_batch(scenes, BATCH, NETWORK, torch.Generator().manual_seed(0))
    exact = losses.compute_losses(engine.network, batch, bfloat16=False)
    coarse = losses.compute_losses(engine.network, batch, bfloat16=True)
    assert coarse.total.item() == pytest.approx(exact.total.item(), rel=0.02)
    assert exact.denoising.tolist() == pytest.approx([1.0, 1.0, 1.0], abs=0.4)


def test_tasks_that_are_left_out_do_not_count() -> None:
    """The others' losses are averaged as if there were no more; their weights get a gradient."""
    config = replace(
        BATCH,
        poses_of=(
            ("grasp", 0),
            ("upright", 0),
        ),
        negatives=0,
    )
    engine = trainer.Trainer(scenes_on_cpu(), NETWORK, config, OPTIMIZER, seed=0, bfloat16=False)
    batch = batches.draw_batch(scenes_on_cpu(), config, NETWORK, torch.Generator().manual_seed(0))
    found = losses.compute_losses(engine.network, batch, bfloat16=False)
    assert found.denoising.shape == (1,)
    expected = found.denoising[0] + losses.FOCAL_WEIGHT * found.focal
    assert found.total.item() == pytest.approx(expected.item())
    found.total.backward()
    gradient = engine.network.score_head.output.weight.grad
    assert gradient is not None
    assert gradient.abs().sum() > 0.0


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
    for name, value in (("step", "x"), ("network", {"a": 1}), ("adam", []), ("generator", 3)):
        torch.save(state | {name: value}, path)
        with pytest.raises(trainer.StateError, match=f"{path} is no state of"):
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
