"""SE(3)-DiffusionFields (arXiv 2209.03855) on each segment of the scene, as it is made for."""

from functools import partial

from scenarios.clutter.detection import with_parameters
from scenarios.clutter.detectors.se3dif import loaded

DETECTOR = with_parameters(
    "se3dif_segments",
    "weights trained here on segments (.safetensors)",
    partial(loaded, "se3dif_segments"),
)
