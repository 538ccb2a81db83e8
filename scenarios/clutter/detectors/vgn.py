"""VGN (arXiv 2101.01132), with the parameters that its authors published."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.baselines.vgn.detector import VgnDetector


def load(checkpoint: Path) -> "VgnDetector":
    """Return VGN with the parameters of a file."""
    from split_drake.baselines.published import load_published
    from split_drake.baselines.vgn.detector import VgnDetector
    from split_drake.baselines.vgn.network import VgnNetwork

    return VgnDetector(load_published(VgnNetwork(), checkpoint))


DETECTOR = with_parameters("vgn", "the .pt file of parameters that its authors published", load)
