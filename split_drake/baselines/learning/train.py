"""Train a method that SPLIT is compared with, on the scenes and labels that SPLIT is trained on.

``python -m split_drake.baselines.learning.train --method vgn --data DIR --fields DIR --out DIR
--minutes 60``

Writes into the output folder: ``weights.safetensors``, those after the epoch that did best on
scenes that were held out; ``curves.jsonl``; ``config.json``; and ``state.pt``, from which
``--resume`` goes on.  A run that is cut short is examined once more, in the middle of an epoch.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from split_drake.bad_input import BadInputError, require_count, require_number, require_numbers
from split_drake.baselines.learning.method import Method, method_named
from split_drake.baselines.learning.pupil import Pupil
from split_drake.baselines.weights import BaselineInfo, save_weights
from split_drake.data.dataset import SceneDataset
from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import git_commit
from split_drake.training.interruption import Interruption
from split_drake.training.memory import keep_freed_memory
from split_drake.training.training_folder import TrainingFolder

WEIGHTS = "weights.safetensors"
_NO_OPTIONS = ("out", "data", "fields", "resume", "log_steps", "save_minutes")


@dataclass(frozen=True)
class TrainConfig:
    """A training run.

    Attributes:
        method: vgn, giga, se3dif or se3dif_segments.
        data: dataset of `split_drake.data.clutter.generate`.
        out: output folder.
        fields: folder of `draw_fields`, for methods that learn from fields.
        minutes: length of the run; give this, `epochs` or `steps`.
        epochs: length of the run in epochs.
        steps: length of the run in optimiser steps.
        scenes: in a batch; the method's own number where none is given.
        seed: of weights, order and batches.
        resume: go on with the run in `out`; only its length may be given anew.
        log_steps: steps averaged in one line of the curves.
        save_minutes: time between two saved states.
    """

    method: str
    data: Path
    out: Path
    fields: Path | None = None
    minutes: float | None = None
    epochs: int | None = None
    steps: int | None = None
    scenes: int | None = None
    seed: int = 0
    resume: bool = False
    log_steps: int = 50
    save_minutes: float = 2.0

    def __post_init__(self) -> None:
        require_numbers(self)
        lengths = [each for each in (self.minutes, self.epochs, self.steps) if each is not None]
        if len(lengths) != 1 or not lengths[0] > 0:
            raise BadInputError(
                f"minutes={self.minutes}, epochs={self.epochs}, steps={self.steps}; "
                "expected one of them, above 0"
            )
        require_count("log_steps", self.log_steps, 1)
        if self.scenes is not None:
            require_count("scenes", self.scenes, 1)
        require_number("save_minutes", self.save_minutes, 0.0)

    def chosen(self) -> Method:
        """Return the method, with the batch's size that was asked for."""
        method = method_named(self.method)
        return method if self.scenes is None else replace(method, scenes=self.scenes)

    def ended(self, pupil: Pupil) -> bool:
        """Return whether the run has its length."""
        if self.minutes is not None:
            return pupil.elapsed_s >= 60.0 * self.minutes
        if self.epochs is not None:
            return pupil.step >= self.epochs * pupil.steps_per_epoch
        assert self.steps is not None  # checked on construction
        return pupil.step >= self.steps

    def record(self) -> dict[str, Any]:
        """Return the options that the outcome depends on, as JSON has them."""
        return {key: value for key, value in asdict(self).items() if key not in _NO_OPTIONS}


class BaselineRun:
    """A training run in its output folder."""

    def __init__(self, config: TrainConfig, console: Console) -> None:
        self._config, self._console = config, console
        self._method = config.chosen()
        dataset = SceneDataset.open(config.data)
        self._dataset_hash = dataset.dataset_hash
        self._commit = git_commit()  # of the code that runs, whatever the tree becomes meanwhile
        torch.manual_seed(config.seed)
        lessons = self._method.prepare(dataset, config.fields)
        self._pupil = Pupil(self._method, lessons, config.seed)
        self._folder = TrainingFolder(config.out, WEIGHTS)
        options = config.record() | {"dataset_hash": self._dataset_hash}
        if begun := self._folder.options():  # sums differ: a run goes on in its type
            lessons.bfloat16 = begun.get("bfloat16", False)
        if lessons.bfloat16:
            options["bfloat16"] = True
        if self._folder.take_up(options, config.resume):
            self._pupil.restore(self._folder.state)
            self._folder.cut_curves(self._pupil.step)
            console.print(f"resumed at step {self._pupil.step}")
        count = sum(each.numel() for each in self._pupil.network.parameters())
        console.print(f"{len(lessons)} scenes, {count / 1e6:.2f} M parameters")

    def execute(self) -> None:
        """Train to the end; Ctrl-C ends the run after a whole step, which is saved."""
        keep_freed_memory()
        pupil, config = self._pupil, self._config
        saved_s, window = pupil.elapsed_s, list[dict[str, float]]()
        with Interruption() as interruption:
            while not config.ended(pupil) and not interruption.requested:
                start_s = time.monotonic()
                window.append(pupil.take_step())
                pupil.elapsed_s += time.monotonic() - start_s
                if pupil.step % config.log_steps == 0:
                    self._report("training", _means(window))
                    window = []
                if pupil.epoch_ended:
                    self._examine()
                if pupil.elapsed_s - saved_s > 60.0 * config.save_minutes:
                    self._save()
                    saved_s = pupil.elapsed_s
            if not pupil.epoch_ended:
                self._examine()
            self._save()
        if interruption.requested:
            raise KeyboardInterrupt

    def _examine(self) -> None:
        self._report("held out", self._pupil.examine())

    def _report(self, of: str, losses: dict[str, float]) -> None:
        """Append losses to the curves and print them."""
        pupil = self._pupil
        scenes, minutes = pupil.step * self._method.scenes, pupil.elapsed_s / 60.0
        self._folder.append_curves(
            {"step": pupil.step, "scenes": scenes, "minutes": round(minutes, 3), "of": of, **losses}
        )
        terms = "  ".join(f"{name} {value:.4f}" for name, value in losses.items())
        self._console.print(
            f"{of:8s}  step {pupil.step}, epoch {pupil.step / pupil.steps_per_epoch:.2f}, "
            f"{minutes:.1f} min, {scenes / max(60.0 * minutes, 1e-6):.1f} scenes/s  {terms}",
            highlight=False,
        )

    def _save(self) -> None:
        """Write the best weights, where an epoch has ended, and the state."""
        pupil = self._pupil
        if pupil.best_step:
            info = BaselineInfo(
                method=self._method.name,
                dataset_hash=self._dataset_hash,
                commit=self._commit,
                seed=self._config.seed,
                epochs=round(pupil.best_step / pupil.steps_per_epoch, 3),
                scenes=pupil.best_step * self._method.scenes,
                minutes=round(pupil.elapsed_s / 60.0, 2),
                validation_loss=pupil.best_loss,
            )
            save_weights(self._folder.weights, pupil.best, info)
        pupil.save(self._folder.state)


def _means(window: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: sum(each[name] for each in window) / len(window) for name in window[0]}


def train(config: TrainConfig, console: Console | None = None) -> None:
    """Train as `config` says; the outcome is in its output folder."""
    console = console or Console(soft_wrap=True)
    with TrainingFolder(config.out, WEIGHTS).locked(config.resume):
        BaselineRun(config, console).execute()


if __name__ == "__main__":
    run_command(train, TrainConfig, __doc__)
