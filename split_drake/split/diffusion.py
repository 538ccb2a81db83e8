"""Sample-frame diffusion on poses: noise, target score, annealed Langevin dynamics (paper IV-D).

A pose X is perturbed to X~ by a Gaussian on SO(3) x R^3 with standard deviation sigma: rotations in
radians, positions in units of `NoiseSchedule.length_m`.  Its density is

    log q(X~ | X) = -(|p~ - p|^2 / length^2 + |Log(R^T R~)|^2) / (2 sigma^2) + const,

and its gradient with respect to a motion [v / length, omega] of X~ in its own frame is

    [-R~^T (p~ - p) / length, -Log(R^T R~)] / sigma^2.

Differs from the paper:
- Rotation and translation are not coupled through the exponential of SE(3): the noise and each step
  are of SO(3) x R^3.  The coupled target needs the Jacobian of that map, which the paper takes from
  automatic differentiation; this one has the closed form above, and a step along it leads to X.
- sigma is from 0.03 to 1.5, not 0.02 to 0.1, whose units are left open: rotations start uniform on
  SO(3), where 0.1 rad is no noise.
- 15 noisy steps at temperature 0.2, then 1 without noise, instead of 100 at temperature 1: what is
  wanted are the modes, and quickly, not the whole density.  `sampler_study` compares.
- The covariance ``sigma I`` is read as ``sigma^2 I``, as which it is sampled.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from split_drake.bad_input import require_numbers
from split_drake.split.se3 import compose, so3_exp, so3_log


@dataclass(frozen=True)
class NoiseSchedule:
    """How far poses are perturbed; part of what a network was trained for.

    Attributes:
        sigma_min, sigma_max: standard deviations at times 0 and 1, geometric in between.
        length_m: the distance that counts as much as one radian.
    """

    sigma_min: float = 0.03
    sigma_max: float = 1.5
    length_m: float = 0.06

    def __post_init__(self) -> None:
        require_numbers(self)
        if not 0.0 < self.sigma_min < self.sigma_max:
            raise ValueError(
                f"sigma_min={self.sigma_min}, sigma_max={self.sigma_max}; "
                "expected 0 < sigma_min < sigma_max"
            )
        if not self.length_m > 0.0:
            raise ValueError(f"length_m is {self.length_m}; expected metres above 0")

    def sigma(self, time: Tensor) -> Tensor:
        """Return the standard deviation at `time` in [0, 1], elementwise."""
        return self.sigma_min * (self.sigma_max / self.sigma_min) ** time

    def descending(self, steps: int) -> list[float]:
        """Return `steps` standard deviations from sigma_max down to sigma_min."""
        return self.between(self.sigma_max, self.sigma_min, steps)

    def between(self, first: float, last: float, steps: int) -> list[float]:
        """Return `steps` standard deviations, geometric, from `first` down to `last`."""
        shares = torch.linspace(1.0, 0.0, steps, dtype=torch.float64)
        return (last * (first / last) ** shares).tolist()


def move(X: Tensor, xi: Tensor, length_m: float) -> Tensor:
    """Return the poses `X` (..., 4, 4) moved by [v / length, omega] (..., 6) in their frames."""
    R, p = X[..., :3, :3], X[..., :3, 3]
    p_moved = p + length_m * (R @ xi[..., :3, None])[..., 0]
    return compose(R @ so3_exp(xi[..., 3:]), p_moved)


def perturb(X: Tensor, sigma: Tensor, length_m: float, generator: torch.Generator) -> Tensor:
    """Return X~ ~ q(. | X) for poses (..., 4, 4) and standard deviations `sigma` (...)."""
    noise = torch.randn((*X.shape[:-2], 6), generator=generator, device=generator.device)
    return move(X, sigma[..., None] * noise.to(X), length_m)


def displacement(X: Tensor, X_noisy: Tensor, length_m: float) -> Tensor:
    """Return [v / length, omega] (..., 6) in the frame of `X_noisy`, pointing away from `X`."""
    R, R_noisy = X[..., :3, :3], X_noisy[..., :3, :3]
    offset = (X_noisy[..., :3, 3] - X[..., :3, 3])[..., None]
    v = (R_noisy.transpose(-1, -2) @ offset)[..., 0] / length_m
    return torch.cat([v, so3_log(R.transpose(-1, -2) @ R_noisy)], -1)


def target_score(X: Tensor, X_noisy: Tensor, sigma: Tensor, length_m: float) -> Tensor:
    """Return sigma times the gradient of log q(X_noisy | X) in the frame of `X_noisy`, (..., 6)."""
    return -displacement(X, X_noisy, length_m) / sigma[..., None]
