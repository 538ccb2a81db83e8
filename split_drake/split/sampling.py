"""Integrators from noise to poses: annealed Langevin dynamics and the probability flow."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor

from split_drake.bad_input import require_count, require_number, require_numbers
from split_drake.split.diffusion import NoiseSchedule, displacement, move

# (poses (..., 4, 4), sigma) -> sigma * score (..., 6) in the poses' own frames.
ScoreFunction = Callable[[Tensor, float], Tensor]
# Called with (step, poses before the step), and at the end with (steps, poses that are returned).
StepCallback = Callable[[int, Tensor], None]
# Positions (..., 3) in V, metres, to where the score is defined: inside the scene.
Confine = Callable[[Tensor], Tensor]


def ignore(step: int, X_VPs: Tensor) -> None:
    """Do nothing: the callback where none is given."""


@dataclass(frozen=True)
class ReverseDiffusion:
    """What integrators take poses through: from noise to samples of the learned density.

    Attributes:
        score: of the density at each noise level.
        schedule: the noise levels that `score` was trained for.
        generator: the only source of chance.
        confine: applied to the positions after each step.
        callback: sees the poses before each step, and those returned.
    """

    score: ScoreFunction
    schedule: NoiseSchedule
    generator: torch.Generator
    confine: Confine
    callback: StepCallback = ignore

    def advance(self, X: Tensor, xi: Tensor) -> Tensor:
        """Return the poses `X` (..., 4, 4) moved by `xi` (..., 6), and confined."""
        X = move(X, xi, self.schedule.length_m)
        X[..., :3, 3] = self.confine(X[..., :3, 3])
        return X

    def noise_like(self, xi: Tensor) -> Tensor:
        """Return standard normal noise of the shape, type and device of `xi`."""
        noise = torch.randn(xi.shape, generator=self.generator, device=self.generator.device)
        return noise.to(xi)

    def levels(self, steps: int) -> list[tuple[float, float]]:
        """Return the noise levels before and after each of `steps` steps; the last leads to 0."""
        return list(pairwise([*self.schedule.descending(steps), 0.0]))


class Integrator(Protocol):
    """Takes poses to samples of the density whose score it is given."""

    def __call__(self, process: ReverseDiffusion, X: Tensor) -> Tensor:
        """Return samples (..., 4, 4) reached from the poses `X` (..., 4, 4)."""


@dataclass(frozen=True)
class LangevinConfig:
    """Annealed Langevin dynamics.

    Attributes:
        steps: noisy steps, one for each sigma from `first_sigma` to `last_sigma`, which are equally
            far apart in log sigma.
        step_scale: alpha / sigma^2 of the paper's step; 2 leads to the mean that the score points
            at, and a little more makes up for few steps.
        temperature: factor on the injected noise; 1 samples the learned density, less favours its
            modes.
        final_steps: noise-free steps at the end, each to the mean that the score points at.
        final_sigma: noise level of those steps.
        first_sigma, last_sigma: noise levels of the first and of the last noisy step; the largest
            and the smallest that the network was trained for where not given.

    All noise levels must be within the schedule that the network was trained for, which
    `annealed_langevin` checks.
    """

    steps: int = 3
    step_scale: float = 2.2
    temperature: float = 0.1
    final_steps: int = 1
    final_sigma: float = 0.1
    first_sigma: float | None = 1.0
    last_sigma: float | None = 0.2

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.steps < 1 or self.final_steps < 0:
            raise ValueError(
                f"steps={self.steps}, final_steps={self.final_steps}; expected at least 1 and 0"
            )
        require_count("steps", self.steps, 1, 10_000)
        require_count("final_steps", self.final_steps, 0, 10_000)
        require_number("step_scale", self.step_scale, 0.0, 10.0)
        require_number("temperature", self.temperature, 0.0, 10.0)
        if self.step_scale <= 0.0 or self.temperature < 0.0 or self.final_sigma <= 0.0:
            raise ValueError(
                f"step_scale={self.step_scale}, temperature={self.temperature}, "
                f"final_sigma={self.final_sigma}; expected > 0, >= 0 and > 0"
            )
        for name in ("first_sigma", "last_sigma"):
            value = getattr(self, name)
            if value is not None:
                require_number(name, value, 0.0, meaning="a noise level")

    @property
    def evaluations(self) -> int:
        """How often the score is evaluated."""
        return self.steps + self.final_steps

    def sigmas(self, schedule: NoiseSchedule) -> list[float]:
        """Return the noise level of each evaluation.

        Raises ValueError where one of them is outside the schedule.
        """
        first = schedule.sigma_max if self.first_sigma is None else self.first_sigma
        last = schedule.sigma_min if self.last_sigma is None else self.last_sigma
        levels = {"first_sigma": first, "last_sigma": last}
        if self.final_steps:
            levels["final_sigma"] = self.final_sigma
        for name, level in levels.items():
            if not schedule.sigma_min <= level <= schedule.sigma_max:
                raise ValueError(
                    f"{name} is {level}; the score was trained for noise from "
                    f"{schedule.sigma_min} to {schedule.sigma_max}"
                )
        return schedule.between(first, last, self.steps) + [self.final_sigma] * self.final_steps


def annealed_langevin(
    process: ReverseDiffusion,
    X: Tensor,
    *,
    config: LangevinConfig,
) -> Tensor:
    """Integrate the dynamics of paper IV-D: an `Integrator` with `config` given.

    A step is X Exp(alpha/2 score + sqrt(alpha) noise) with alpha = step_scale * sigma^2.  `score`
    returns sigma * score, so that alpha/2 score = step_scale/2 * sigma * score(...).

    Raises ValueError where a step is at a noise level outside the schedule.
    """
    sigmas = config.sigmas(process.schedule)
    for step, sigma in enumerate(sigmas):
        process.callback(step, X)
        xi = sigma * process.score(X, sigma)
        if step < config.steps:
            spread = config.temperature * math.sqrt(config.step_scale) * sigma
            xi = 0.5 * config.step_scale * xi + spread * process.noise_like(xi)
        X = process.advance(X, xi)
    process.callback(len(sigmas), X)
    return X


def _in_frame_of(X: Tensor, X_moved: Tensor, xi: Tensor) -> Tensor:
    """Return motions (..., 6) of the poses `X_moved`, given in their frames, in those of `X`."""
    R = X[..., :3, :3].mT @ X_moved[..., :3, :3]
    return (R @ xi.unflatten(-1, (2, 3)).mT).mT.flatten(-2)


def heun(
    process: ReverseDiffusion,
    X: Tensor,
    *,
    steps: int,
) -> Tensor:
    """Integrate the probability flow dX = -sigma score dsigma by Heun's method.

    2 * steps - 1 evaluations; algorithm 1 of Karras et al., "Elucidating the design space of
    diffusion-based generative models" (2022), without its optional noise.
    """
    for step, (sigma, following) in enumerate(process.levels(steps)):
        process.callback(step, X)
        velocity = process.score(X, sigma)
        tried = process.advance(X, (sigma - following) * velocity)
        if following > 0.0:
            there = _in_frame_of(X, tried, process.score(tried, following))
            mean = 0.5 * (velocity + there)
            tried = process.advance(X, (sigma - following) * mean)
        X = tried
    process.callback(steps, X)
    return X


def multistep(
    process: ReverseDiffusion,
    X: Tensor,
    *,
    steps: int,
) -> Tensor:
    """Integrate the probability flow by an exponential integrator in log sigma.

    `steps` evaluations; DPM-Solver++(2M) of Lu et al. (2022): the mean that the score points at is
    extrapolated linearly from the last two, which are equally far apart in log sigma.
    """
    last: Tensor | None = None
    for step, (sigma, following) in enumerate(process.levels(steps)):
        process.callback(step, X)
        mean = move(X, sigma * process.score(X, sigma), process.schedule.length_m)
        goal = mean
        if last is not None and following > 0.0:
            change = displacement(last, mean, process.schedule.length_m)
            goal = move(mean, 0.5 * change, process.schedule.length_m)
        towards = -displacement(goal, X, process.schedule.length_m)
        X = process.advance(X, (1.0 - following / sigma) * towards)
        last = mean
    process.callback(steps, X)
    return X


def predictor_corrector(
    process: ReverseDiffusion,
    X: Tensor,
    *,
    steps: int,
    temperature: float,
) -> Tensor:
    """Alternate a step of the probability flow (Euler) and one of Langevin dynamics.

    2 * steps - 1 evaluations; after Song et al., "Score-based generative modeling through
    stochastic differential equations" (2021).  The Langevin step, with alpha = sigma^2, is that of
    paper IV-D; its noise is scaled by `temperature`.
    """
    for step, (sigma, following) in enumerate(process.levels(steps)):
        process.callback(step, X)
        X = process.advance(X, (sigma - following) * process.score(X, sigma))
        if following > 0.0:
            drift = 0.5 * process.score(X, following)
            xi = following * (drift + temperature * process.noise_like(drift))
            X = process.advance(X, xi)
    process.callback(steps, X)
    return X
