"""Train SPLIT: ``python -m split_drake.training.train --data DIR --out DIR --minutes 60``.

Writes into the output folder: ``split.safetensors`` (the averaged weights, usable at any time),
``curves.jsonl`` (a line every `log_steps` steps), ``config.json``, and ``state.pt``, from which
``--resume`` goes on after an interruption, on the same type of device.

Only runs with ``--steps`` are reproducible: with ``--minutes`` the learning rate falls as time
passes, however many steps that makes.
"""

import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
from rich.console import Console
from rich.progress import Progress

from split_drake.bad_input import BadInputError, require_count, require_number, require_numbers
from split_drake.data.dataset import SceneDataset
from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import file_sha256, git_commit
from split_drake.pose_task import UnknownTaskError, find_tasks
from split_drake.scene import Workspace
from split_drake.split.checkpoint import CheckpointInfo, load_checkpoint, save_checkpoint
from split_drake.split.network_config import SplitConfig
from split_drake.training.batches import BatchConfig
from split_drake.training.interruption import Interruption
from split_drake.training.losses import Losses
from split_drake.training.memory import keep_freed_memory
from split_drake.training.precision import Precision, uses_bfloat16
from split_drake.training.trainer import OptimizerConfig, StateError, Trainer
from split_drake.training.training_folder import TrainingFolder
from split_drake.training.training_scenes import TrainingScenes
from split_drake.training.workers.team import TakeStep, require_divisible, team

# What a line of the curves holds beside the tasks' losses, so that no task may be called so.
_LINE_KEYS = frozenset(("step", "scenes", "minutes", "learning_rate", "focal"))


@dataclass(frozen=True)
class TrainConfig:
    """A training run.

    Attributes:
        data: folder written by split_drake.data.generate; its tasks and its workspace are those
            of the network.
        out: output folder.
        minutes: length of the run; give this or `steps`.
        steps: length of the run in optimiser steps.
        device: "auto" takes CUDA where there is one.
        precision: of matrix products and fine convolutions; "auto" takes bfloat16 where that is
            faster here: processors that only emulate it take a multiple of the time.  A run that
            was begun goes on in its type.
        workers: processes that train together on a CPU.  Each draws an equal share of every batch,
            and their gradients are averaged.  They divide the threads that PyTorch would use.
            ``tests/benchmarks/test_training.py`` tells whether that is faster on a machine.  The
            weights depend on the number, but a run may be resumed with another one.
        seed: of weights and batches.
        tasks: names of those of the dataset's tasks that are trained; all where none is named.
        resume: go on with the run in `out`; only its length may be given anew.
        init: checkpoint to take the first weights from; it may know more tasks.
        log_steps: steps averaged in one line of the curves.
        save_minutes: time between two saved states.
        network: architecture.
        batch: what a batch is made of.
        optimizer: how the weights are moved.
    """

    data: Path
    out: Path
    minutes: float | None = None
    steps: int | None = None
    device: Literal["auto", "cpu", "cuda"] = "auto"
    precision: Precision = "auto"
    workers: int = 1
    seed: int = 0
    tasks: tuple[str, ...] = ()
    resume: bool = False
    init: Path | None = None
    log_steps: int = 50
    save_minutes: float = 2.0
    network: SplitConfig = field(default_factory=SplitConfig)
    batch: BatchConfig = field(default_factory=BatchConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)

    def __post_init__(self) -> None:
        require_numbers(self)
        if (self.minutes is None) == (self.steps is None):
            raise ValueError(f"minutes={self.minutes}, steps={self.steps}; expected one of them")
        if self.minutes is not None and not self.minutes > 0.0:
            raise BadInputError(f"minutes is {self.minutes}; expected more than 0")
        if self.steps is not None:
            require_count("steps", self.steps, 1)
        require_count("workers", self.workers, 1)
        require_count("log_steps", self.log_steps, 1)
        require_number("save_minutes", self.save_minutes, 0.0)

    def torch_device(self) -> torch.device:
        """Return the device to train on."""
        if self.device == "auto":
            return torch.device("cuda" if torch.cuda.is_available() else "cpu")
        return torch.device(self.device)

    def progress(self, trainer: Trainer) -> float:
        """Return which share of the run is done, 1 or more at its end."""
        if self.steps is not None:
            return trainer.step / self.steps
        assert self.minutes is not None  # checked on construction
        return trainer.elapsed_s / (60.0 * self.minutes)

    def record(self) -> dict[str, object]:
        """Return the options as JSON values, without those that do not change the outcome.

        Data and first weights are recorded by their hashes, not by where they were.
        """
        options = asdict(self)
        for key in ("resume", "out", "data", "init", "log_steps", "save_minutes"):
            del options[key]
        if self.workers == 1:  # as all runs were before there was a choice
            del options["workers"]
        return json.loads(json.dumps(options, default=str))


def parent_record(path: Path, info: CheckpointInfo) -> dict[str, Any]:
    """Return what `CheckpointInfo.parent` tells of the checkpoint in `path`."""
    return {
        "sha256": file_sha256(path),
        "commit": info.commit,
        "dataset_hash": info.dataset_hash,
        "steps": info.steps,
        "scenes": info.scenes,
        "parent": info.parent,
    }


def _require_fitting(network: SplitConfig, workspace: Workspace) -> None:
    """Exit where a network's grid is not that of the dataset's workspace."""
    try:
        network.require_cube_of(workspace)
    except ValueError as error:
        raise SystemExit(f"{error}; --network.edge-m and --network.table-m set it") from error


class TrainingRun:
    """A training run in its output folder."""

    def __init__(self, config: TrainConfig, dataset: SceneDataset, console: Console) -> None:
        self._config, self._console = config, console
        self._folder = TrainingFolder(config.out)
        self._dataset_hash = dataset.dataset_hash
        self._commit = git_commit()
        self._earlier_commits: tuple[str, ...] = ()
        self._parent: dict[str, Any] | None = None
        try:
            self._tasks = find_tasks(config.tasks or dataset.tasks, dataset.tasks, "the dataset")
        except UnknownTaskError as error:
            raise SystemExit(f"--tasks: {error}") from error
        if taken := _LINE_KEYS.intersection(map(str, self._tasks)):
            raise SystemExit(
                f"a task is called {min(taken)!r}; expected none of {sorted(_LINE_KEYS)}"
            )
        self._workspace = dataset.workspace
        _require_fitting(config.network, dataset.workspace)
        self._trained = [task.name for task in config.batch.trained(self._tasks)]
        device = config.torch_device()
        require_divisible(config.batch.scenes, config.workers, device)
        begun = self._folder.options().get("bfloat16") if config.precision == "auto" else None
        self._bfloat16 = uses_bfloat16(config.precision, device) if begun is None else begun
        scenes = TrainingScenes.of(dataset, self._tasks, device)
        if config.workers > 1:
            scenes.share()
        self._make_trainer = partial(
            Trainer,
            scenes,
            config.network,
            config.batch.share(config.workers),
            config.optimizer,
            config.seed,
            self._bfloat16,
        )
        self._trainer = self._make_trainer()
        if config.init is not None:
            self._start_from(config.init)
        options = config.record() | {
            "bfloat16": self._bfloat16,
            "dataset_hash": self._dataset_hash,
            "parent": self._parent,
        }
        if self._folder.take_up(options, config.resume):
            self._go_on()
        self._console.print(
            f"{len(scenes)} scenes on {scenes.p_VSs.device}, "
            f"{sum(p.numel() for p in self._trainer.network.parameters()) / 1e6:.2f} M parameters"
        )

    def _start_from(self, path: Path) -> None:
        """Take over the weights of a checkpoint."""
        network, info = load_checkpoint(path)
        try:
            self._trainer.start_from(network)
        except ValueError as error:
            raise SystemExit(f"{path} cannot be started from: {error}") from error
        if network.close_up is not None:
            self._console.print(f"the second look of {path} is left out", markup=False)
        self._parent = parent_record(path, info)

    def _go_on(self) -> None:
        """Take up the state in the folder, and what its weights say of the commits before."""
        try:
            self._trainer.restore(self._folder.state)
        except StateError as error:
            raise SystemExit(str(error)) from error
        self._folder.cut_curves(self._trainer.step)
        _, info = load_checkpoint(self._folder.weights)
        commits = (*info.earlier_commits, info.commit)
        self._earlier_commits = commits[:-1] if commits[-1] == self._commit else commits
        self._console.print(f"resumed at step {self._trainer.step}")

    def _windows(self, take_step: TakeStep, interruption: Interruption) -> Iterator[list[Losses]]:
        """Train until the end or an interruption; yield the losses of each `log_steps` steps."""
        trainer, window = self._trainer, list[Losses]()
        while (progress := self._config.progress(trainer)) < 1.0 and not interruption.requested:
            start = time.monotonic()
            losses = take_step(progress)
            trainer.elapsed_s += time.monotonic() - start
            window.append(Losses(losses.denoising.detach(), losses.focal.detach()))
            if trainer.step % self._config.log_steps == 0:
                yield window
                window = []

    def execute(self) -> None:
        """Train to the end; Ctrl-C ends the run after a whole step, which is saved."""
        keep_freed_memory()
        trainer, config = self._trainer, self._config
        saved_s = trainer.elapsed_s
        with (
            team(self._make_trainer, trainer, config.workers) as take_step,
            Progress(console=self._console, disable=not self._console.is_terminal) as bar,
            Interruption() as interruption,
        ):
            task = bar.add_task("training", total=1.0)
            for window in self._windows(take_step, interruption):
                self._report(window)
                bar.update(task, completed=config.progress(trainer))
                if trainer.elapsed_s - saved_s > 60.0 * config.save_minutes:
                    self._save()
                    saved_s = trainer.elapsed_s
            self._save()
        if interruption.requested:
            raise KeyboardInterrupt

    def _report(self, window: list[Losses]) -> None:
        """Append the means of `window` to the curves and print them."""
        trainer, config = self._trainer, self._config
        denoising = torch.stack([losses.denoising for losses in window]).mean(0).tolist()
        progress = config.progress(trainer)
        line = {
            "step": trainer.step,
            "scenes": trainer.step * config.batch.scenes,
            "minutes": round(trainer.elapsed_s / 60.0, 3),
            "learning_rate": config.optimizer.rate(trainer.step, progress),
            **dict(zip(self._trained, denoising, strict=True)),
            "focal": torch.stack([losses.focal for losses in window]).mean().item(),
        }
        self._folder.append_curves(line)
        left_min = trainer.elapsed_s / 60.0 * (1.0 / max(progress, 1e-6) - 1.0)
        self._console.print(
            f"step {trainer.step}  {line['minutes']:.1f} min, {left_min:.0f} left  "
            f"{line['scenes'] / max(trainer.elapsed_s, 1e-6):.1f} scenes/s  "
            + "  ".join(f"{name} {line[name]:.4f}" for name in self._trained)
            + f"  focal {line['focal']:.5f}",
            highlight=False,
        )

    def _save(self) -> None:
        """Write the averaged weights, unless they are not finite, and then the state."""
        trainer, config = self._trainer, self._config
        info = CheckpointInfo(
            config=config.network,
            tasks=self._tasks,
            workspace=self._workspace,
            training=config.record(),
            seed=config.seed,
            dataset_hash=self._dataset_hash,
            commit=self._commit,
            steps=trainer.step,
            scenes=trainer.step * config.batch.scenes,
            earlier_commits=self._earlier_commits,
            parent=self._parent,
        )
        save_checkpoint(self._folder.weights, trainer.average, info)
        trainer.save(self._folder.state)


def train(config: TrainConfig, console: Console | None = None) -> None:
    """Train as `config` says; the outcome is in its output folder."""
    console = console or Console(soft_wrap=True)
    dataset = SceneDataset.open(config.data)
    with TrainingFolder(config.out).locked(config.resume):
        TrainingRun(config, dataset, console).execute()


if __name__ == "__main__":
    torch.set_float32_matmul_precision("high")
    run_command(train, TrainConfig)
