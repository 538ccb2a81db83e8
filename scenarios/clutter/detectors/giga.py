"""GIGA (arXiv 2104.01542), with weights trained here or published by its authors."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import TRAINED_OR_PUBLISHED, with_parameters

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.baselines.giga.detector import GigaDetector


def load(checkpoint: Path) -> "GigaDetector":
    """Return GIGA with the weights of a file."""
    from split_drake.baselines.giga.detector import GigaDetector
    from split_drake.baselines.giga.network import GigaNetwork
    from split_drake.baselines.weights import load_weights

    return GigaDetector(load_weights(GigaNetwork(), "giga", checkpoint))


DETECTOR = with_parameters("giga", TRAINED_OR_PUBLISHED, load)
