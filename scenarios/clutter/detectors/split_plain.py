"""SPLIT without a memory of what failed, as the methods beside it in Table I."""

from scenarios.clutter.detection import with_parameters
from scenarios.clutter.detectors.split import load, workspace

DETECTOR = with_parameters(
    "split_plain", "weights such as models/weights/split_clutter.safetensors", load, workspace
)
