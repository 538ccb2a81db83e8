"""SE(3)-DiffusionFields (arXiv 2209.03855) on the whole scene, as the paper shows it."""

from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.clutter.detection import with_parameters

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.baselines.se3dif.detector import Se3DifDetector


def load(checkpoint: Path) -> "Se3DifDetector":
    """Return the detector of whole scenes with the weights of a file."""
    return loaded("se3dif", checkpoint)


def loaded(method: str, checkpoint: Path) -> "Se3DifDetector":
    """Return the detector with the weights that a method was trained to: "se3dif", or of segments.

    It computes in what the processor does in hardware.

    Raises BaselineWeightsError where the file holds others.
    """
    from split_drake.baselines.se3dif.detector import Se3DifDetector
    from split_drake.baselines.se3dif.network import Se3DifNetwork
    from split_drake.baselines.weights import load_weights
    from split_drake.training.precision import uses_bfloat16

    network = load_weights(Se3DifNetwork(), method, checkpoint)
    in_bfloat16 = uses_bfloat16("auto")
    return Se3DifDetector(network, segments=method != "se3dif", in_bfloat16=in_bfloat16)


DETECTOR = with_parameters("se3dif", "weights trained here (.safetensors)", load)
