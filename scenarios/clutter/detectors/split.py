"""SPLIT, the method that this project is about."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


def load(checkpoint: Path) -> "SplitDetector":
    """Return SPLIT with the weights of a checkpoint, and the sampler of clutter."""
    from split_drake.split.detector import CLUTTER_SAMPLER, SplitDetector

    return SplitDetector.from_checkpoint(checkpoint, CLUTTER_SAMPLER)


DETECTOR = with_parameters(
    "split", "weights such as models/weights/split_clutter.safetensors", load
)
