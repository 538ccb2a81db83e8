"""SPLIT, the method that this project is about."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters
from split_drake.scene import Workspace

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


def load(checkpoint: Path) -> "SplitDetector":
    """Return SPLIT with the weights of a checkpoint, and the sampler of clutter."""
    from split_drake.split.detector import CLUTTER_SAMPLER, SplitDetector

    return SplitDetector.from_checkpoint(checkpoint, CLUTTER_SAMPLER)


def workspace(checkpoint: Path | None) -> Workspace:
    """Return the workspace that the network was trained on."""
    from split_drake.split.checkpoint import load_checkpoint

    assert checkpoint is not None  # `clutter_detector` has seen to it
    return load_checkpoint(checkpoint)[1].workspace


DETECTOR = with_parameters(
    "split", "weights such as models/weights/split_clutter.safetensors", load, workspace
)
