"""Other ways from scores to samples than annealed Langevin dynamics, for `sampler_study`.

All go down the schedule's noise levels and end with a step to the mean that the score points at.
The methods are known from vector spaces; here a step is a motion of a pose in its own frame, and
motions are compared in one frame.
"""

from itertools import pairwise

import torch
from torch import Tensor

from split_drake.split.diffusion import (
    Confine,
    NoiseSchedule,
    ScoreFunction,
    StepCallback,
    advance,
    displacement,
    move,
)


def _levels(schedule: NoiseSchedule, steps: int) -> list[tuple[float, float]]:
    """Return the noise levels before and after each of `steps` steps; the last leads to 0."""
    return list(pairwise([*schedule.descending(steps), 0.0]))


def _in_frame_of(X: Tensor, X_moved: Tensor, xi: Tensor) -> Tensor:
    """Return motions (..., 6) of the poses `X_moved`, given in their frames, in those of `X`."""
    R = X[..., :3, :3].mT @ X_moved[..., :3, :3]
    return (R @ xi.unflatten(-1, (2, 3)).mT).mT.flatten(-2)


def heun(
    score: ScoreFunction,
    X: Tensor,
    schedule: NoiseSchedule,
    generator: torch.Generator,
    confine: Confine,
    callback: StepCallback,
    *,
    steps: int,
) -> Tensor:
    """Integrate the probability flow dX = -sigma score dsigma by Heun's method.

    2 * steps - 1 evaluations; algorithm 1 of Karras et al., "Elucidating the design space of
    diffusion-based generative models" (2022), without its optional noise.
    """
    for step, (sigma, following) in enumerate(_levels(schedule, steps)):
        callback(step, X)
        velocity = score(X, sigma)
        tried = advance(X, (sigma - following) * velocity, schedule, confine)
        if following > 0.0:
            there = _in_frame_of(X, tried, score(tried, following))
            mean = 0.5 * (velocity + there)
            tried = advance(X, (sigma - following) * mean, schedule, confine)
        X = tried
    callback(steps, X)
    return X


def multistep(
    score: ScoreFunction,
    X: Tensor,
    schedule: NoiseSchedule,
    generator: torch.Generator,
    confine: Confine,
    callback: StepCallback,
    *,
    steps: int,
) -> Tensor:
    """Integrate the probability flow by an exponential integrator in log sigma.

    `steps` evaluations; DPM-Solver++(2M) of Lu et al. (2022): the mean that the score points at is
    extrapolated linearly from the last two, which are equally far apart in log sigma.
    """
    last: Tensor | None = None
    for step, (sigma, following) in enumerate(_levels(schedule, steps)):
        callback(step, X)
        mean = move(X, sigma * score(X, sigma), schedule.length_m)
        goal = mean
        if last is not None and following > 0.0:
            change = displacement(last, mean, schedule.length_m)
            goal = move(mean, 0.5 * change, schedule.length_m)
        towards = -displacement(goal, X, schedule.length_m)
        X = advance(X, (1.0 - following / sigma) * towards, schedule, confine)
        last = mean
    callback(steps, X)
    return X


def predictor_corrector(
    score: ScoreFunction,
    X: Tensor,
    schedule: NoiseSchedule,
    generator: torch.Generator,
    confine: Confine,
    callback: StepCallback,
    *,
    steps: int,
    temperature: float,
) -> Tensor:
    """Alternate a step of the probability flow (Euler) and one of Langevin dynamics.

    2 * steps - 1 evaluations; after Song et al., "Score-based generative modeling through
    stochastic differential equations" (2021).  The Langevin step, with alpha = sigma^2, is that of
    paper IV-D; its noise is scaled by `temperature`.
    """
    for step, (sigma, following) in enumerate(_levels(schedule, steps)):
        callback(step, X)
        X = advance(X, (sigma - following) * score(X, sigma), schedule, confine)
        if following > 0.0:
            drift = 0.5 * score(X, following)
            noise = torch.randn(drift.shape, generator=generator, device=generator.device)
            xi = following * (drift + temperature * noise.to(drift))
            X = advance(X, xi, schedule, confine)
    callback(steps, X)
    return X
