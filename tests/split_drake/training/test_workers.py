"""Several processes that train together: one network in all, which is lost with none of them."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, multiprocessing

from split_drake.split.network import SplitNetwork
from split_drake.training import batches, losses, trainer
from split_drake.training.train import TrainConfig, train
from split_drake.training.workers.peers import Peers, joined
from split_drake.training.workers.team import require_divisible, team
from tests.helpers.training import BATCH, NETWORK, OPTIMIZER, make_scenes, scenes_on_cpu

SHARE = BATCH.share(2)


def make_trainer() -> trainer.Trainer:
    """Return the trainer of one of two processes."""
    return trainer.Trainer(scenes_on_cpu(), NETWORK, SHARE, OPTIMIZER, seed=0, bfloat16=False)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Sums come out in one order only where there is one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@contextmanager
def beside(act: Callable[[Peers, Path], None], folder: Path) -> Iterator[Peers]:
    """Yield the first of two peers; the second one acts in a process of its own."""
    process = multiprocessing.get_context("spawn").Process(target=second, args=(act, folder))
    process.start()
    with joined(0, 2, folder / "meeting") as peers:
        yield peers
    process.join()
    assert process.exitcode == 0


def second(act: Callable[[Peers, Path], None], folder: Path) -> None:
    torch.set_num_threads(1)
    with joined(1, 2, folder / "meeting") as peers:
        act(peers, folder)


def whole_batch() -> batches.TrainingBatch:
    return batches.draw_batch(scenes_on_cpu(), BATCH, NETWORK, torch.Generator().manual_seed(0))


def half_of(batch: batches.TrainingBatch, rank: int) -> batches.TrainingBatch:
    """Return the first or the second half of a batch's scenes."""
    part = slice(rank * SHARE.scenes, (rank + 1) * SHARE.scenes)
    names = {field.name for field in fields(batch)} - {"tasks", "task_groups"}
    return replace(batch, **{name: getattr(batch, name)[part] for name in names})


def frozen_network() -> SplitNetwork:
    """Return a network whose batch norms don't tell scenes of the same batch of each other."""
    return make_trainer().network.eval()


def gradients(network: SplitNetwork) -> list[Tensor]:
    return [p.grad for p in network.parameters() if p.grad is not None]


def average_of_half(peers: Peers, folder: Path) -> None:
    """Save the averaged gradients that this process has when it has seen its half of the batch."""
    network = frozen_network()
    found = losses.compute_losses(network, half_of(whole_batch(), peers.rank), bfloat16=False)
    found.total.backward()
    mean = peers.average(network, found)
    torch.save((gradients(network), mean.denoising, mean.focal), folder / f"{peers.rank}.pt")


def test_averaged_gradients_are_those_of_the_whole_batch(tmp_path: Path) -> None:
    network = frozen_network()
    expected = losses.compute_losses(network, whole_batch(), bfloat16=False)
    expected.total.backward()
    with beside(average_of_half, tmp_path) as peers:
        average_of_half(peers, tmp_path)
    for rank in range(2):
        found, denoising, focal = torch.load(tmp_path / f"{rank}.pt")
        torch.testing.assert_close(denoising, expected.denoising)
        torch.testing.assert_close(focal, expected.focal)
        for one, other in zip(found, gradients(network), strict=True):
            torch.testing.assert_close(one, other, atol=1e-6, rtol=1e-4)


def three_steps(peers: Peers, folder: Path) -> None:
    """Take three steps, of which the second process spoils the second; save each state."""
    engine = make_trainer()
    engine.peers = peers
    for step in range(3):
        with pytest.MonkeyPatch.context() as patch:
            if (peers.rank, step) == (1, 1):
                patch.setattr(trainer, "draw_batch", draw_batch_of_nan)
            engine.take_step(0.5)
        engine.save(folder / f"{peers.rank}_{step}.pt")


def draw_batch_of_nan(*args: Any) -> batches.TrainingBatch:
    """Return a batch whose voxels are not finite."""
    batch = batches.draw_batch(*args)
    return replace(batch, occupied=torch.full(batch.occupied.shape, torch.nan))


def test_all_processes_hold_the_same_network_and_skip_the_same_steps(tmp_path: Path) -> None:
    with beside(three_steps, tmp_path) as peers:
        three_steps(peers, tmp_path)
    states = [[torch.load(tmp_path / f"{rank}_{step}.pt") for step in range(3)] for rank in (0, 1)]
    for first, second in zip(*states, strict=True):
        assert_same(first["network"], second["network"])
        assert_same(first["average"], second["average"])
        assert torch.equal(first["generator"], second["generator"])
    learned, skipped, further = states[0]
    assert [state["skipped"] for state in states[0]] == [0, 1, 0]
    assert_same(learned["network"], skipped["network"])
    for name, value in further["network"].items():
        assert torch.isfinite(value).all(), name
    name = "encoder.blocks.0.reduce.1.running_mean"
    assert not torch.equal(skipped["network"][name], further["network"][name])


def assert_same(one: dict[str, Tensor], other: dict[str, Tensor]) -> None:
    assert one.keys() == other.keys()
    for name, value in one.items():
        assert torch.equal(value, other[name]), name


def test_each_process_draws_its_own_share_from_a_generator_that_is_the_same_in_all() -> None:
    runs = [torch.Generator().manual_seed(3) for _ in range(2)]
    first, second = (Peers(rank, 2).generator(run) for rank, run in enumerate(runs))
    assert torch.rand((), generator=first) != torch.rand((), generator=second)
    assert torch.equal(runs[0].get_state(), runs[1].get_state())
    again = Peers(0, 2).generator(runs[0])
    assert again.initial_seed() != first.initial_seed()


@pytest.fixture
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrainConfig:
    """Return a run of two processes, of 12 steps that are saved every 4."""
    monkeypatch.setattr(
        "split_drake.training.train.SceneDataset.open", lambda folder: make_scenes()
    )
    return TrainConfig(
        data=tmp_path / "posts",
        out=tmp_path / "run",
        steps=12,
        device="cpu",
        precision="float32",
        workers=2,
        log_steps=4,
        save_minutes=0.0,
        network=NETWORK,
        batch=BATCH,
        optimizer=OPTIMIZER,
    )


def act_at(step: int, act: Callable[[], None], patch: pytest.MonkeyPatch) -> None:
    """Have something happen when the first process begins the step with this number."""
    take_step = trainer.Trainer.take_step

    def acting(engine: trainer.Trainer, progress: float) -> losses.Losses:
        if engine.step == step:
            act()
        return take_step(engine, progress)

    patch.setattr(trainer.Trainer, "take_step", acting)


def signal_worker(number: int) -> None:
    """Send a signal to the one worker there is."""
    (worker,) = multiprocessing.active_children()
    assert worker.pid is not None
    os.kill(worker.pid, number)


def press_ctrl_c() -> None:
    """Do what a terminal does at Ctrl-C: all processes are told."""
    signal_worker(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)


def test_a_run_resumed_after_ctrl_c_is_to_the_bit_the_one_that_was_not_interrupted(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, broken = (replace(options, out=options.out / name) for name in ("whole", "broken"))
    train(whole)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        act_at(5, press_ctrl_c, patch)
        train(broken)
    assert torch.load(broken.out / "state.pt")["step"] == 6
    train(replace(broken, resume=True))
    assert multiprocessing.active_children() == []
    expected, found = (torch.load(run.out / "state.pt") for run in (whole, broken))
    assert (expected["step"], found["step"]) == (12, 12)
    assert_same(expected["network"], found["network"])
    assert_same(expected["average"], found["average"])


def test_a_lost_worker_ends_the_run_which_another_number_of_processes_can_resume(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    message = "^worker 1 was killed by signal 9 after step 6; --resume goes on"
    with monkeypatch.context() as patch, pytest.raises(SystemExit, match=message):
        act_at(6, partial(signal_worker, signal.SIGKILL), patch)
        train(options)
    assert torch.load(options.out / "state.pt")["step"] == 4
    train(replace(options, resume=True, workers=1))
    assert torch.load(options.out / "state.pt")["step"] == 12


def in_no_worker(first: int) -> trainer.Trainer:
    """Return a trainer in the process `first`; fail in others."""
    if os.getpid() != first:
        raise RuntimeError("a worker cannot make its trainer")
    return make_trainer()


def test_a_worker_that_does_not_start_ends_the_run(capfd: pytest.CaptureFixture[str]) -> None:
    make = partial(in_no_worker, os.getpid())
    with pytest.raises(SystemExit, match="worker 1 failed with exit code 1"), team(make, make(), 2):
        pytest.fail("nothing can be trained")
    assert "a worker cannot make its trainer" in capfd.readouterr().err


def test_a_run_that_diverges_ends_in_all_processes() -> None:
    engine = make_trainer()
    with torch.no_grad():
        engine.network.score_head.output.bias.fill_(float("nan"))
    with team(make_trainer, engine, 2) as take_step:
        (worker,) = multiprocessing.active_children()
        for _ in range(OPTIMIZER.tolerated_steps):
            take_step(0.0)
        with pytest.raises(trainer.TrainingDivergedError, match="4 steps in a row"):
            take_step(0.0)
        worker.join()
        assert worker.exitcode == 0
    assert engine.peers is None


def test_no_workers_at_all_are_refused(options: TrainConfig) -> None:
    with pytest.raises(ValueError, match="workers is 0; expected a whole number, 1 or more"):
        train(replace(options, workers=0))
    assert not options.out.exists()


@pytest.mark.parametrize("workers", [3, 8])
def test_a_number_that_does_not_divide_the_batch_is_refused(
    options: TrainConfig, workers: int
) -> None:
    message = f"^--workers is {workers}; expected a divisor of --batch.scenes, which is 4$"
    with pytest.raises(SystemExit, match=message):
        train(replace(options, workers=workers))
    assert not options.out.exists()


def test_only_one_process_trains_on_a_graphics_card() -> None:
    require_divisible(4, 1, torch.device("cuda"))
    with pytest.raises(SystemExit, match="on cuda only one process can train"):
        require_divisible(4, 2, torch.device("cuda"))


def test_a_run_of_one_process_is_recorded_as_before_there_was_a_choice(
    options: TrainConfig,
) -> None:
    assert options.record()["workers"] == 2
    assert "workers" not in replace(options, workers=1).record()
    engine = make_trainer()
    with team(make_trainer, engine, 1) as take_step:
        assert take_step == engine.take_step
