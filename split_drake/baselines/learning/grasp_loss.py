"""What VGN and GIGA minimise at labelled palms (arXiv 2101.01132, IV-B; 2104.01542, IV-C)."""

import torch
from torch import Tensor
from torch.nn import functional

from split_drake.baselines.learning.volume_lessons import LabelledPalms

WIDTH_WEIGHT = 0.01


def grasp_losses(
    quality: Tensor, quaternion_xyzw: Tensor, width_voxels: Tensor, palms: LabelledPalms
) -> dict[str, Tensor]:
    """Return the losses of quality (B, N), quaternion (B, N, 4) and width (B, N), each ().

    Rotation and width count where the palm is true.
    """
    counted, true = palms.counted, palms.counted * palms.label
    entropy = functional.binary_cross_entropy(quality, palms.label, reduction="none")
    error = rotation_error(quaternion_xyzw, palms.quaternion_xyzw)
    squared = (width_voxels - palms.width_voxels).square()
    whole = counted.sum().clamp(min=1.0)
    return {
        "quality": (counted * entropy).sum() / whole,
        "rotation": (true * error).sum() / whole,
        "width": WIDTH_WEIGHT * (true * squared).sum() / whole,
    }


def rotation_error(found: Tensor, wanted: Tensor) -> Tensor:
    """Return 1 - |q . q'| for quaternions (..., 4), the smaller one of both half turns about z."""
    x, y, z, w = wanted.unbind(-1)
    half_turned = torch.stack([y, -x, w, -z], -1)
    alike = torch.maximum((found * wanted).sum(-1).abs(), (found * half_turned).sum(-1).abs())
    return 1.0 - alike
