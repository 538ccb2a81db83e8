"""GIGA (arXiv 2104.01542), with the parameters that its authors published."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.baselines.giga.detector import GigaDetector


def load(checkpoint: Path) -> "GigaDetector":
    """Return GIGA with the parameters of a file."""
    from split_drake.baselines.giga.detector import GigaDetector
    from split_drake.baselines.giga.network import GigaNetwork
    from split_drake.baselines.published import load_published

    return GigaDetector(load_published(GigaNetwork(), checkpoint))


DETECTOR = with_parameters("giga", "the .pt file of parameters that its authors published", load)
