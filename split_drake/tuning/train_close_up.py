"""Teach a checkpoint to take a second, close look at the best of its grasps in clutter.

    python -m split_drake.tuning.train_close_up judge --checkpoint F --out DIR
    python -m split_drake.tuning.train_close_up train --judged DIR --init F --out FILE

The first draws grasps in scenes of clutter and has geometry judge them.  The second trains the
network of close-ups (`split_drake.split.close_up`) on them; the rest of the checkpoint stays as it
is.  It is kept beside the file every `SAVED_STEPS` steps, so that an interrupted run goes on.
"""

import math
import os
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import torch
from rich.console import Console

from split_drake.bad_input import BadInputError, require_count, require_number, require_numbers
from split_drake.experiments.command import run_commands
from split_drake.experiments.provenance import combined_sha256, file_sha256, git_commit
from split_drake.experiments.run import CONFIG
from split_drake.files import replacing
from split_drake.split.checkpoint import CheckpointInfo, load_checkpoint, save_checkpoint
from split_drake.split.close_up.config import CloseUpConfig
from split_drake.split.close_up.network import CloseUpNetwork
from split_drake.split.detector import CLUTTER_SAMPLER
from split_drake.split.network import SplitNetwork
from split_drake.station.layout import Layout
from split_drake.training.precision import uses_bfloat16
from split_drake.training.train import parent_record
from split_drake.tuning.close_up_training import (
    BEST_SHARE,
    CloseUpBatches,
    JudgedViews,
    second_look,
    train_steps,
)
from split_drake.tuning.judged_views import BEST, JudgeViewsConfig, judge_views

LOG_STEPS, SAVED_STEPS = 200, 1000
# What reading a file raises that is no state of a run.
_DAMAGED = (
    *(OSError, RuntimeError, KeyError, ValueError, TypeError),
    *(IndexError, EOFError, UnpicklingError),
)


@dataclass(frozen=True)
class TrainCloseUpConfig:
    """How the second look is learnt.

    Attributes:
        judged: folder written by `judge`.
        init: checkpoint that drew the judged grasps.
        out: checkpoint to write.
        steps: optimiser steps.
        learning_rate: of AdamW at the first step; it falls to 0 like a cosine.
        weight_decay: of AdamW.
        scenes, grasps: of a step, and of each of its scenes.
        seed: of the weights and the batches.
        workers: processes that draw batches; 0 for this one.  The outcome does not depend on them.
        close_up: what close-ups show, and the network.
    """

    judged: Path
    init: Path
    out: Path
    steps: int = 10_000
    learning_rate: float = 1.5e-3
    weight_decay: float = 1e-3
    scenes: int = 6
    grasps: int = 32
    seed: int = 0
    workers: int = len(os.sched_getaffinity(0)) - 1
    close_up: CloseUpConfig = field(default_factory=CloseUpConfig)

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("steps", "scenes", "grasps"):
            require_count(name, getattr(self, name), 1)
        require_count("workers", self.workers)
        require_count("grasps", self.grasps, 1, round(BEST / BEST_SHARE))
        for name in ("learning_rate", "weight_decay"):
            require_number(name, getattr(self, name), 0.0, 1.0)

    def record(self) -> dict[str, Any]:
        """Return what the outcome depends on."""
        left_out = ("judged", "init", "out", "workers")
        options = {name: value for name, value in asdict(self).items() if name not in left_out}
        of = {
            "judged": file_sha256(self.judged / CONFIG),
            "init": file_sha256(self.init),
        }
        return options | of

    def rate(self, step: int) -> float:
        """Return the learning rate of a step."""
        return self.learning_rate * 0.5 * (1.0 + math.cos(math.pi * step / self.steps))


class CloseUpRun:
    """A training run, kept in a file beside its checkpoint until that is written.

    Attributes:
        network: what is trained.
        step: steps that were taken.
        bfloat16: whether it is trained in bfloat16, as was measured when the run began.

    Args:
        config: of the run.

    Raises BadInputError where the file is of another run.
    """

    def __init__(self, config: TrainCloseUpConfig) -> None:
        torch.manual_seed(config.seed)
        self._config = config
        self._path = config.out.with_suffix(".state")
        self.network = CloseUpNetwork(config.close_up)
        self.adam = torch.optim.AdamW(
            self.network.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        self.step = 0
        self.bfloat16 = False
        if self._path.is_file():
            self._go_on()
        else:
            self.bfloat16 = uses_bfloat16("auto")

    def _go_on(self) -> None:
        try:
            state = torch.load(self._path, weights_only=True)
            record, step, bfloat16 = state["record"], int(state["step"]), bool(state["bfloat16"])
            if record == repr(self._config.record()):
                self.network.load_state_dict(state["network"])
                self.adam.load_state_dict(state["adam"])
                self.step, self.bfloat16 = step, bfloat16
                return
        except _DAMAGED as error:
            raise BadInputError(f"{self._path} is damaged; remove it to start anew") from error
        raise BadInputError(
            f"{self._path} is of a run with other options; remove it, or give another --out"
        )

    def save(self) -> None:
        """Write what the run goes on from, atomically."""
        state = {
            "record": repr(self._config.record()),
            "step": self.step,
            "bfloat16": self.bfloat16,
            "network": self.network.state_dict(),
            "adam": self.adam.state_dict(),
        }
        with replacing(self._path) as temporary:
            torch.save(state, temporary)

    def finish(self) -> None:
        """Remove what the run would go on from."""
        self._path.unlink(missing_ok=True)

    def train(self, judged: JudgedViews, console: Console) -> None:
        """Take all the steps that are left."""
        config, losses = self._config, list[float]()
        batches = CloseUpBatches(
            judged,
            config.close_up,
            range(self.step, config.steps),
            config.scenes,
            config.grasps,
            config.seed,
        )
        self._set_rate()
        for loss in train_steps(self.network, self.adam, batches, config.workers, self.bfloat16):
            self.step += 1
            self._set_rate()
            losses.append(loss)
            if self.step % LOG_STEPS == 0:
                console.print(f"step {self.step}  loss {np.mean(losses[-LOG_STEPS:]):.4f}")
            if self.step % SAVED_STEPS == 0 or self.step == config.steps:
                self.save()

    def _set_rate(self) -> None:
        for group in self.adam.param_groups:
            group["lr"] = self._config.rate(self.step)


def train(config: TrainCloseUpConfig) -> None:
    """Train, print what it brought on shards that were held out, and write the checkpoint."""
    console = Console(soft_wrap=True)
    network, info = load_checkpoint(config.init)
    used, held_out = (JudgedViews.open(config.judged, held_out=each) for each in (False, True))
    if used.checkpoint != file_sha256(config.init):
        raise BadInputError(
            f"the grasps of {config.judged} were drawn by another checkpoint than {config.init}"
        )
    if used.workspace != info.workspace:
        raise BadInputError(
            f"{config.judged} is of {used.workspace}, {config.init} of {info.workspace}: "
            "expected the same"
        )
    run = CloseUpRun(config)
    run.train(used, console)
    quality = second_look(run.network, held_out, CLUTTER_SAMPLER.close_ups)
    for name, value in quality.items():
        console.print(f"{name}, held out: {value:.3f}")
    looking = _with_close_up(network, run.network)
    save_checkpoint(config.out, looking, _info(run, config, info, looking, quality))
    run.finish()


def _with_close_up(network: SplitNetwork, close_up: CloseUpNetwork) -> SplitNetwork:
    """Return a network that takes a second look as well."""
    looking = SplitNetwork(replace(network.config, close_up=close_up.config), network.tasks)
    looking.take_over(network)
    assert looking.close_up is not None
    looking.close_up.load_state_dict(close_up.state_dict())
    return looking.eval()


def _info(
    run: CloseUpRun,
    config: TrainCloseUpConfig,
    info: CheckpointInfo,
    network: SplitNetwork,
    quality: dict[str, float],
) -> CheckpointInfo:
    """Return where the network comes from."""
    return replace(
        info,
        config=network.config,
        training={name: str(value) for name, value in config.record().items()}
        | {"bfloat16": run.bfloat16},
        seed=config.seed,
        dataset_hash=_judged_sha256(config.judged),
        commit=git_commit(),
        steps=config.steps,
        scenes=config.steps * config.scenes,
        metrics={"close_up": quality},
        earlier_commits=(),
        parent=parent_record(config.init, info),
    )


def _judged_sha256(folder: Path) -> str:
    """Return a hash of all shards of a folder."""
    return combined_sha256({path.stem: file_sha256(path) for path in sorted(folder.glob("*.npz"))})


def main(config: JudgeViewsConfig | TrainCloseUpConfig) -> None:
    """Run one of the commands."""
    if isinstance(config, TrainCloseUpConfig):
        train(config)
        return
    _, info = load_checkpoint(config.checkpoint)
    judge_views(config, Layout(workspace=info.workspace))


if __name__ == "__main__":
    run_commands(main, {"judge": JudgeViewsConfig, "train": TrainCloseUpConfig})
