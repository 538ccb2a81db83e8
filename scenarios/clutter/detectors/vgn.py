"""VGN (arXiv 2101.01132), with weights trained here or published by its authors."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import TRAINED_OR_PUBLISHED, with_parameters

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.baselines.vgn.detector import VgnDetector


def load(checkpoint: Path) -> "VgnDetector":
    """Return VGN with the weights of a file."""
    from split_drake.baselines.vgn.detector import VgnDetector
    from split_drake.baselines.vgn.network import VgnNetwork
    from split_drake.baselines.weights import load_weights

    return VgnDetector(load_weights(VgnNetwork(), "vgn", checkpoint))


DETECTOR = with_parameters("vgn", TRAINED_OR_PUBLISHED, load)
