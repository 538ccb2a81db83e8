"""SPLIT with sixteen evaluations of its score: the long sampler, and both looks."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters
from scenarios.clutter.detectors.split import workspace

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


def load(checkpoint: Path) -> "SplitDetector":
    """Return SPLIT with the weights of a checkpoint, and the long sampler."""
    from split_drake.split.detector import CLUTTER_SAMPLER, SIXTEEN_EVALUATIONS, SplitDetector

    long = replace(CLUTTER_SAMPLER, langevin=SIXTEEN_EVALUATIONS.langevin)
    return SplitDetector.from_checkpoint(checkpoint, long)


DETECTOR = with_parameters(
    "split_16", "weights such as models/weights/split_clutter.safetensors", load, workspace
)
