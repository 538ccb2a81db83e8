"""SPLIT without its second look at the best grasps: the evaluator of the paper alone ranks them."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters
from scenarios.clutter.detectors.split import workspace

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


def load(checkpoint: Path) -> "SplitDetector":
    """Return SPLIT with the weights of a checkpoint, looking once."""
    from split_drake.split.detector import ONE_LOOK, SplitDetector

    return SplitDetector.from_checkpoint(checkpoint, ONE_LOOK)


DETECTOR = with_parameters(
    "split_once", "weights such as models/weights/split_clutter.safetensors", load, workspace
)
