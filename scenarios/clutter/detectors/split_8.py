"""SPLIT with eight evaluations of its score and one look, as its earlier figures were."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters
from scenarios.clutter.detectors.split import workspace

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


def load(checkpoint: Path) -> "SplitDetector":
    """Return SPLIT with the weights of a checkpoint, and the longer sampler."""
    from split_drake.split.detector import EIGHT_EVALUATIONS, SplitDetector

    return SplitDetector.from_checkpoint(checkpoint, EIGHT_EVALUATIONS)


DETECTOR = with_parameters(
    "split_8", "weights such as models/weights/split_clutter.safetensors", load, workspace
)
