"""Fields and palms, turned by quarters about z and moved up and down, as VGN is trained."""

import torch
from torch import Tensor

from split_drake.baselines.learning.volume_lessons import LabelledPalms, inside
from split_drake.baselines.tsdf import RESOLUTION

# VGN moves a scene so that one of its palms comes to a height between these, in voxels.
HEIGHTS_VOXELS = (6.0, 34.0)


def turned(palms: LabelledPalms, generator: torch.Generator) -> LabelledPalms:
    """Return each scene turned by a random number of quarters about the cube's middle."""
    quarters = torch.randint(4, (len(palms.fields),), generator=generator)
    fields = torch.stack(
        [
            torch.rot90(field, int(k), dims=(0, 1))
            for field, k in zip(palms.fields, quarters, strict=True)
        ]
    )
    voxels = turned_points(palms.voxels, quarters)
    half = torch.pi / 4.0 * quarters
    about_z = torch.zeros(len(quarters), 1, 4)
    about_z[:, 0, 2], about_z[:, 0, 3] = half.sin(), half.cos()
    return palms._replace(
        fields=fields,
        voxels=voxels,
        quaternion_xyzw=quaternion_product(about_z, palms.quaternion_xyzw),
        counted=palms.counted * inside(voxels),
    )


def turned_points(voxels: Tensor, quarters: Tensor) -> Tensor:
    """Return positions (B, N, 3) in voxels after so many quarters (B,) about the cube's middle."""
    middle = RESOLUTION / 2.0
    x, y, z = (voxels - voxels.new_tensor([middle, middle, 0.0])).unbind(-1)
    cos = voxels.new_tensor([1.0, 0.0, -1.0, 0.0])[quarters][:, None]
    sin = voxels.new_tensor([0.0, 1.0, 0.0, -1.0])[quarters][:, None]
    return torch.stack([cos * x - sin * y + middle, sin * x + cos * y + middle, z], -1)


def raised(palms: LabelledPalms, generator: torch.Generator) -> LabelledPalms:
    """Return each scene moved by whole voxels along z, its first palm to a random height."""
    low, high = HEIGHTS_VOXELS
    wanted = low + (high - low) * torch.rand(len(palms.fields), generator=generator)
    steps = (wanted - palms.voxels[:, 0, 2]).round().long()
    voxels = palms.voxels.clone()
    voxels[..., 2] += steps[:, None]
    fields = torch.stack(
        [_shifted(field, int(step)) for field, step in zip(palms.fields, steps, strict=True)]
    )
    return palms._replace(fields=fields, voxels=voxels, counted=palms.counted * inside(voxels))


def _shifted(field: Tensor, step: int) -> Tensor:
    """Return a field (r, r, r) moved along z; nothing was seen where it came from."""
    moved = torch.zeros_like(field)
    if step >= 0:
        moved[..., step:] = field[..., : RESOLUTION - step]
    else:
        moved[..., :step] = field[..., -step:]
    return moved


def quaternion_product(first: Tensor, second: Tensor) -> Tensor:
    """Return the quaternions (..., 4), x y z w, that turn by `second` and then by `first`."""
    u, s = first[..., :3], first[..., 3:]
    v, t = second[..., :3], second[..., 3:]
    u, v = torch.broadcast_tensors(u, v)
    imaginary = s * v + t * u + torch.linalg.cross(u, v)
    return torch.cat([imaginary, s * t - (u * v).sum(-1, keepdim=True)], -1)
