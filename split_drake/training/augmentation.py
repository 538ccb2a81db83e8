"""Augmentation: scenes are turned, shifted and a little scaled, and their points made noisy.

Differs from the paper:
- The points' noise is drawn anew for each scene, from none to 8 mm, rather than 5 mm for all.
- Positions are scaled by 2.5% at most.  The hand keeps its size, so scaling by s moves what it has
  around it at a height z by (s - 1) z: 2 mm at 8 cm, which is the room that labels leave between
  hand and table.  Mugs of other sizes are other shapes of the data set.
- No points are dropped: whether a true grasp can be seen is part of its label, and what cameras
  miss is drawn with the scenes.
"""

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor
from torch.nn import functional

from split_drake.bad_input import require_numbers
from split_drake.pose_task import Symmetry
from split_drake.split.network_config import SplitConfig
from split_drake.split.se3 import compose, so3_exp


@dataclass(frozen=True)
class AugmentationConfig:
    """How much scenes are changed.

    Attributes:
        shift_m: largest shift along x and y.
        scale: largest relative change of all positions.
        noise_m: range that the standard deviation of a scene's noise is drawn from.
        range_scale: standard deviation of the relative error of all distances from the camera, one
            draw a scene: what is left of a depth camera's scale error.
    """

    shift_m: float = 0.02
    scale: float = 0.025
    noise_m: tuple[float, float] = (0.0, 0.008)
    range_scale: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        low_m, high_m = self.noise_m
        if not 0.0 <= low_m <= high_m:
            raise ValueError(f"noise_m is {self.noise_m}; expected 0 <= lowest <= highest")
        if not 0.0 <= self.range_scale < 1.0:
            raise ValueError(f"range_scale is {self.range_scale}; expected 0 or more, below 1")
        if self.shift_m < 0.0 or not 0.0 <= self.scale < 1.0:
            raise ValueError(
                f"shift_m={self.shift_m}, scale={self.scale}; expected 0 or more, and below 1"
            )


@dataclass(frozen=True)
class Similarity:
    """One similarity transform a scene: yaw about the workspace's vertical axis, scale, shift.

    Poses keep orthonormal rotations: only their positions are scaled.

    Attributes:
        R: (B, 3, 3).
        scale: (B,).
        p_VCenter: (3,) centre of the workspace on the table.
        shift: (B, 3).
    """

    R: Tensor
    scale: Tensor
    p_VCenter: Tensor
    shift: Tensor

    @classmethod
    def draw(
        cls,
        scenes: int,
        config: AugmentationConfig,
        split: SplitConfig,
        generator: torch.Generator,
    ) -> Self:
        """Return random transforms, on the generator's device."""
        device = generator.device
        uniform = torch.rand(scenes, 4, generator=generator, device=device) * 2.0 - 1.0
        yaw, scale, shift = uniform[:, 0], uniform[:, 1], uniform[:, 2:]
        zero = torch.zeros_like(yaw)
        return cls(
            R=so3_exp(torch.stack([zero, zero, torch.pi * yaw], -1)),
            scale=1.0 + config.scale * scale,
            p_VCenter=torch.tensor([split.edge_m / 2, split.edge_m / 2, split.table_m]).to(device),
            shift=config.shift_m * functional.pad(shift, (0, 1)),
        )

    def points(self, p_Vs: Tensor) -> Tensor:
        """Return the points (B, N, 3) transformed."""
        turned = (p_Vs - self.p_VCenter) @ self.R.transpose(-1, -2)
        return turned * self.scale[:, None, None] + (self.p_VCenter + self.shift)[:, None]

    def poses(self, X_Vs: Tensor) -> Tensor:
        """Return the poses (B, N, 4, 4) transformed."""
        return compose(self.R[:, None] @ X_Vs[..., :3, :3], self.points(X_Vs[..., :3, 3]))


def misjudge_range(
    p_VSs: Tensor, p_VCs: Tensor, config: AugmentationConfig, generator: torch.Generator
) -> Tensor:
    """Return points (B, N, 3) moved along their rays from cameras (B, 3), by one factor a scene."""
    if not config.range_scale:
        return p_VSs
    error = torch.randn(len(p_VSs), 1, 1, generator=generator, device=generator.device)
    return p_VSs + config.range_scale * error * (p_VSs - p_VCs[:, None])


def add_noise(p_VSs: Tensor, config: AugmentationConfig, generator: torch.Generator) -> Tensor:
    """Return the points (B, N, 3) with normal noise, of one standard deviation a scene."""
    low_m, high_m = config.noise_m
    share = torch.rand(len(p_VSs), 1, 1, generator=generator, device=generator.device)
    noise = torch.randn(p_VSs.shape, generator=generator, device=generator.device)
    return p_VSs + (low_m + (high_m - low_m) * share) * noise


def turned_alike(X_VPs: Tensor, symmetry: Symmetry, generator: torch.Generator) -> Tensor:
    """Return for each pose (B, N, 4, 4) one of those that mean the same, by chance."""
    if symmetry.kind == "none":
        return X_VPs
    if symmetry.kind == "half turn":
        turned = torch.randint(2, X_VPs.shape[:2], generator=generator, device=generator.device)
        signs = X_VPs.new_ones((*turned.shape, 4))
        across = [i for i in range(3) if i != symmetry.column]
        signs[..., across] = (1 - 2 * turned)[..., None].to(signs)
        return X_VPs * signs[..., None, :]
    angle = torch.rand(X_VPs.shape[:2], generator=generator, device=generator.device)
    omega = X_VPs.new_zeros((*X_VPs.shape[:2], 3))
    omega[..., symmetry.column] = 2.0 * torch.pi * angle
    return compose(X_VPs[..., :3, :3] @ so3_exp(omega), X_VPs[..., :3, 3])


def voxelize(p_VSs: Tensor, split: SplitConfig) -> Tensor:
    """Return (B, r, r, r) voxels, true where one of the points (B, N, 3) lies: `Scene.grid`."""
    r, scenes = split.resolution, len(p_VSs)
    index = torch.floor(p_VSs / split.edge_m * r).long()
    scene = torch.arange(scenes, device=p_VSs.device)[:, None]
    flat = ((scene * r + index[..., 0]) * r + index[..., 1]) * r + index[..., 2]
    inside = ((index >= 0) & (index < r)).all(-1)
    # What lies outside goes to one more cell: picking the rest would wait for a GPU.
    occupied = torch.zeros(scenes * r**3 + 1, dtype=torch.bool, device=p_VSs.device)
    occupied[torch.where(inside, flat, scenes * r**3)] = True
    return occupied[:-1].view(scenes, r, r, r)
