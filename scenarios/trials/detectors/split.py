"""SPLIT; a look that follows a failure takes 16 evaluations of its network, and spreads grasps."""

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from planning.subgoal import Subgoal
from scenarios.trials.detection import Detectors, TrialDetector
from scenarios.trials.setup import Setup
from scenarios.trials.spec import TrialSpec
from split_drake.pose_task import find_tasks
from split_drake.scene import Workspace

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


def make(spec: TrialSpec, setup: Setup) -> Detectors:
    """Return SPLIT with as many evaluations as the trial wants, and with more."""
    usual = _loaded(spec.checkpoint, spec.evaluations)
    return Detectors(usual, usual.thorough(), usual.widened())


def weights(checkpoint: Path | None) -> Path:
    """Return the checkpoint, or the weights that ship."""
    from split_drake.split.checkpoint import default_weights

    return checkpoint or default_weights()


def check(checkpoint: Path | None, task: Subgoal) -> None:
    """Raise CheckpointError for a file of no use, UnknownTaskError for one that lacks a task."""
    from split_drake.split.checkpoint import load_checkpoint

    path = weights(checkpoint)
    _, info = load_checkpoint(path)
    find_tasks(task.perceived_tasks, info.tasks, str(path))


def workspace(checkpoint: Path | None) -> Workspace:
    """Return the workspace that the network was trained on."""
    from split_drake.split.checkpoint import load_checkpoint

    _, info = load_checkpoint(weights(checkpoint))
    return info.workspace


@lru_cache(maxsize=1)
def _loaded(checkpoint: Path | None, evaluations: int) -> "SplitDetector":
    """Return this process's SPLIT."""
    from split_drake.split.detector import SAMPLERS, single_threaded_detector

    return single_threaded_detector(checkpoint, SAMPLERS[evaluations])


DETECTOR = TrialDetector("split", make, weights, check, workspace)
