"""What the second look is trained on, and that it learns."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from split_drake.bad_input import BadInputError
from split_drake.experiments.run import CONFIG
from split_drake.files import write_json
from split_drake.pose_task import GRASP
from split_drake.scene import Workspace
from split_drake.split.checkpoint import load_checkpoint
from split_drake.split.close_up.config import CloseUpConfig
from split_drake.split.close_up.network import CloseUpNetwork
from split_drake.split.detector import SplitDetector
from split_drake.station.layout import Layout
from split_drake.tuning import train_close_up
from split_drake.tuning.close_up_training import (
    CloseUpBatches,
    JudgedViews,
    second_look,
    train_steps,
    with_some_noise,
)
from split_drake.tuning.judged_views import (
    BEST,
    DEPTH_UNIT_M,
    OTHERS,
    JudgeViewsConfig,
    write_judged_views,
)
from split_drake.tuning.train_close_up import CloseUpRun, TrainCloseUpConfig
from tests.helpers.checkpoints import save_new_network
from tests.split_drake.data.clutter.conftest import Blocks

CLOSE_UP = CloseUpConfig(cells=(4, 16, 8), channels=(4, 8, 8, 8), width=16)
SHARDS, SCENES = 10, 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of judged grasps of blocks, by a network that has learnt nothing."""
    out = tmp_path_factory.mktemp("views")
    save_new_network(out / "split.safetensors")
    config = JudgeViewsConfig(out / "split.safetensors", out, SHARDS, SCENES, workers=1)
    for name in config.names():
        write_judged_views(config, Blocks(), Layout(), name)
        with_high_ones_held(out / f"{name}.npz")
    write_json(out / CONFIG, config.record(Blocks(), Layout()) | {"shards": config.names()})
    return out


def with_high_ones_held(path: Path) -> None:
    """Have the higher half of a shard's grasps hold, in place of what geometry says of them."""
    arrays = dict(np.load(path))
    heights_m = arrays["sampled"][..., 2, 3]
    arrays["held"] = heights_m > np.median(heights_m)
    np.savez(path, **arrays)


@pytest.fixture(scope="module")
def judged(folder: Path) -> JudgedViews:
    return JudgedViews.open(folder, held_out=False)


def config_of(folder: Path, out: Path) -> TrainCloseUpConfig:
    return TrainCloseUpConfig(
        folder,
        folder / "split.safetensors",
        out,
        steps=6,
        scenes=2,
        grasps=16,
        workers=0,
        close_up=CLOSE_UP,
    )


def test_shards_hold_images_and_judged_grasps(folder: Path, judged: JudgedViews) -> None:
    assert len(judged) == (SHARDS - 1) * SCENES
    assert len(JudgedViews.open(folder, held_out=True)) == SCENES
    arrays = judged.arrays
    assert arrays["sampled"].shape[1:] == (BEST + OTHERS, 4, 4)
    logits = arrays["logits"]
    assert (np.diff(logits[:, :BEST], axis=1) <= 0.0).all(), "the best come first"
    assert (logits[:, BEST:].max(axis=1) <= logits[:, BEST - 1]).all()
    assert 0.0 < arrays["held"].mean() < 1.0
    first, last = judged.depth_m(0), judged.depth_m(len(judged) - 1)
    assert tuple(first.shape) == tuple(arrays["sizes"][0])
    for image in (first, last):
        assert image[image > 0.0].min() > 0.3 and image.max() < 1.5
        assert not torch.equal(image, with_some_noise(image, torch.Generator().manual_seed(1)))


def test_a_shard_depends_on_its_number_alone(folder: Path, tmp_path: Path) -> None:
    config = JudgeViewsConfig(folder / "split.safetensors", tmp_path, SHARDS, SCENES, workers=1)
    write_judged_views(config, Blocks(), Layout(), "views_0003")
    again, before = (np.load(out / "views_0003.npz") for out in (tmp_path, folder))
    for name in set(again) - {"held"}:
        np.testing.assert_array_equal(again[name], before[name])


def test_noise_is_none_or_normal_or_smooth() -> None:
    image = torch.full((80, 80), 0.6)
    image[:4] = 0.0
    spreads = []
    for seed in range(40):
        noisy = with_some_noise(image, torch.Generator().manual_seed(seed))
        assert (noisy[:4] == 0.0).all() and noisy.shape == image.shape
        seen = noisy[4:]
        spreads.append((float(seen.std()), float((seen[:, 1:] - seen[:, :-1]).std())))
        assert abs(float(seen.mean()) - 0.6) < 0.002
    spread, steps = np.transpose(spreads)
    assert (spread < 1e-6).sum() in range(3, 20), "none"
    assert ((spread > 0.002) & (steps < 0.8 * spread)).sum() in range(3, 20), "smooth"
    assert (steps > 1.2 * spread).sum() in range(10, 32), "normal"


def test_batches_depend_on_seed_and_step_alone(judged: JudgedViews) -> None:
    whole = CloseUpBatches(judged, CLOSE_UP, range(4), 2, 16, 7)
    rest = CloseUpBatches(judged, CLOSE_UP, range(2, 4), 2, 16, 7)
    shown, held = whole[2]
    assert shown.shape == (32, 4, *CLOSE_UP.cells) and held.shape == (32,)
    assert len(rest) == 2
    for one, other in zip((shown, held), rest[0], strict=True):
        torch.testing.assert_close(one, other)
    assert not torch.equal(shown, whole[1][0])
    losses = [
        list(train_steps(network, torch.optim.AdamW(network.parameters()), whole, workers, False))
        for workers in (0, 2)
        for network in [new_close_up()]
    ]
    assert losses[0] == losses[1], "whoever draws the batches"


def new_close_up() -> CloseUpNetwork:
    torch.manual_seed(0)
    return CloseUpNetwork(CLOSE_UP)


def test_it_learns_what_it_sees(judged: JudgedViews) -> None:
    drawn = CloseUpBatches(judged, CLOSE_UP, range(16), 2, 32, 0)
    batches = [drawn[step] for step in range(16)] * 10  # smoothing is what takes time
    network = new_close_up()
    adam = torch.optim.AdamW(network.parameters(), 3e-3)
    losses = list(train_steps(network, adam, batches, 0, False))
    assert np.mean(losses[-30:]) < 0.8 * np.mean(losses[:10])
    found = second_look(network, judged, 48)
    assert found["auc_second"] > found["auc_first"] + 0.1
    assert found["top_second"] >= found["top_first"]
    assert found["any"] >= max(found["top_first"], found["top_second"], found["top_both"])


def test_a_run_goes_on_where_it_was_interrupted(
    folder: Path, judged: JudgedViews, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    console = Console(quiet=True)
    config = config_of(folder, tmp_path / "whole.safetensors")
    whole = CloseUpRun(config)
    whole.train(judged, console)
    monkeypatch.setattr(train_close_up, "SAVED_STEPS", 2)
    monkeypatch.setattr(train_close_up, "train_steps", interrupted_after(3))
    begun = CloseUpRun(replace(config, out=tmp_path / "part.safetensors"))
    with pytest.raises(KeyboardInterrupt):
        begun.train(judged, console)
    monkeypatch.setattr(train_close_up, "train_steps", train_steps)
    again = CloseUpRun(replace(config, out=tmp_path / "part.safetensors"))
    assert again.step == 2
    again.train(judged, console)
    for name, value in again.network.state_dict().items():
        torch.testing.assert_close(value, whole.network.state_dict()[name])
    other = replace(config, out=tmp_path / "part.safetensors", seed=1)
    with pytest.raises(BadInputError, match="of a run with other options; remove it"):
        CloseUpRun(other)
    (tmp_path / "part.state").write_bytes(b"no state")
    with pytest.raises(BadInputError, match=r"part\.state is damaged"):
        CloseUpRun(replace(config, out=tmp_path / "part.safetensors"))


def interrupted_after(steps: int):  # type: ignore[no-untyped-def]
    def train(*arguments):  # type: ignore[no-untyped-def]
        for number, loss in enumerate(train_steps(*arguments), start=1):
            yield loss
            if number == steps:
                raise KeyboardInterrupt

    return train


def test_the_command_writes_a_checkpoint_that_looks_twice(folder: Path, tmp_path: Path) -> None:
    config = config_of(folder, tmp_path / "looking.safetensors")
    train_close_up.main(config)
    network, info = load_checkpoint(config.out)
    before, _ = load_checkpoint(config.init)
    assert network.close_up is not None and info.config.close_up == CLOSE_UP
    for name, value in before.state_dict().items():
        torch.testing.assert_close(network.state_dict()[name], value)
    assert info.steps == 6 and info.parent is not None
    assert "auc_both" in info.metrics["close_up"]
    assert not config.out.with_suffix(".state").exists()
    assert GRASP in SplitDetector.from_checkpoint(config.out).tasks


def test_what_cannot_be_trained_on_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="does not exist; expected a folder of judged views"):
        JudgedViews.open(tmp_path, held_out=False)
    record = {"workspace": asdict(Workspace()), "shards": ["views_0000"], "checkpoint": "abc"}
    write_json(tmp_path / CONFIG, record)
    with pytest.raises(BadInputError, match="has 1 shards; expected at least 10"):
        JudgedViews.open(tmp_path, held_out=False)
    names = [f"views_{number:04d}" for number in range(SHARDS)]
    write_json(tmp_path / CONFIG, record | {"shards": names})
    with pytest.raises(BadInputError, match=r"9 shards are missing, .*views_0000\.npz the first"):
        JudgedViews.open(tmp_path, held_out=False)
    elsewhere = tmp_path / "elsewhere.safetensors"
    save_new_network(elsewhere, replace(Workspace(), table_clearance_m=0.01))
    with pytest.raises(BadInputError, match="were drawn by another checkpoint than"):
        train_close_up.main(replace(config_of(folder, tmp_path / "out"), init=elsewhere))
    for name, value in (("steps", 0), ("grasps", 200)):
        with pytest.raises(BadInputError, match=f"{name} is {value}; expected"):
            replace(config_of(folder, tmp_path), **{name: value})  # type: ignore[arg-type]
    assert DEPTH_UNIT_M * np.iinfo(np.uint16).max > 3.0
