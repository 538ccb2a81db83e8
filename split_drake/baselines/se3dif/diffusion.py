"""Noise of poses, and how poses are drawn by an energy's gradient (arXiv 2209.03855, III and V)."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from split_drake.baselines.se3dif.network import Se3DifNetwork
from split_drake.split.se3 import so3_exp, uniform_rotations

# The standard deviation at time 1 is 0.74, at the first time 0.032, in scaled units and radians.
SIGMA = 0.5
FIRST_TIME = 1e-3
_CHUNK = 64


@dataclass(frozen=True)
class Se3DifSampler:
    """How poses are drawn.

    Attributes:
        samples: poses of each cloud.
        steps: with noise that falls, of Langevin dynamics; the authors take 70 for partial clouds.
        still_steps: without noise, at the end; the authors take 50 for these.
    """

    samples: int = 24
    steps: int = 70
    still_steps: int = 50

    def __post_init__(self) -> None:
        if min(self.samples, self.steps) < 1 or self.still_steps < 0:
            raise ValueError(
                f"samples={self.samples}, steps={self.steps}, still_steps={self.still_steps}; "
                "expected one or more, and not less than no still steps"
            )

    def draw(
        self, network: Se3DifNetwork, code: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return rotations (N, 3, 3), scaled positions (N, 3) and energies (N,) by a code (L,)."""
        R = uniform_rotations((self.samples,), generator)
        p = torch.randn(self.samples, 3, generator=generator)
        codes = code.expand(self.samples, -1)
        for step in range(self.steps + self.still_steps):
            time = torch.full((self.samples,), self._time(step))
            _, gradient = network.energy_gradient(codes, R, p, time)
            # Langevin's step of the variance at that time.
            size = sigma(time)[:, None] ** 2
            delta = -0.5 * size * gradient
            if step < self.steps:
                noise = torch.randn(self.samples, 6, generator=generator)
                delta = delta + size.sqrt() * noise
            R, p = so3_exp(delta[:, 3:]) @ R, p + delta[:, :3]
        energy, _ = network.energy_gradient(codes, R, p, torch.full_like(p[:, 0], FIRST_TIME))
        return R, p, energy.detach()

    def _time(self, step: int) -> float:
        """Return the time of a step, which falls to the first one."""
        return max(0.0, (self.steps - step) / self.steps) * (1.0 - FIRST_TIME) + FIRST_TIME


def sigma(time: Tensor) -> Tensor:
    """Return the standard deviation of the noise at times in [0, 1], any shape."""
    log = math.log(SIGMA)
    return ((SIGMA ** (2.0 * time) - 1.0) / (2.0 * log)).sqrt()


def denoising_loss(
    network: Se3DifNetwork, code: Tensor, R: Tensor, p: Tensor, generator: torch.Generator
) -> Tensor:
    """Return the L1 distance between the energy's gradient and the noise over its variance, / 10.

    Args:
        code: (P, L) of the cloud that each true pose is beside.
        R, p: (P, 3, 3) and scaled (P, 3) of true poses.
    """
    time = torch.rand(len(R), generator=generator) * (1.0 - FIRST_TIME) + FIRST_TIME
    std = sigma(time)[:, None]
    noise = torch.randn(len(R), 6, generator=generator)
    moved = std * noise
    _, gradient = network.energy_gradient(
        code, so3_exp(moved[:, 3:]) @ R, p + moved[:, :3], time, training=True
    )
    return (gradient - noise / std).abs().mean() / 10.0
