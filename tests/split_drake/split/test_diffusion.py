"""Noise schedule, target score against automatic differentiation, and the samplers."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import pytest
import torch
from torch import Tensor

from split_drake.split.diffusion import NoiseSchedule, displacement, move, perturb, target_score
from split_drake.split.sampling import (
    Integrator,
    LangevinConfig,
    ReverseDiffusion,
    ScoreFunction,
    annealed_langevin,
    heun,
    multistep,
    predictor_corrector,
)
from split_drake.split.se3 import compose, so3_exp, so3_log, uniform_rotations

LENGTH_M = 0.06


def random_poses(count: int, generator: torch.Generator) -> Tensor:
    """Return (count, 4, 4) float64 poses within a cube of 0.3 m."""
    p = 0.3 * torch.rand(count, 3, generator=generator)
    return compose(uniform_rotations((count,), generator), p).double()


@pytest.mark.parametrize("sigma", [0.03, 0.1, 0.5, 1.0, 1.5])
def test_target_score_is_the_gradient_of_the_kernels_log_density(sigma: float) -> None:
    generator = torch.Generator().manual_seed(0)
    X = random_poses(200, generator)
    sigmas = torch.full((200,), sigma, dtype=torch.float64)
    X_noisy = perturb(X, sigmas, LENGTH_M, generator)
    delta = torch.zeros(200, 6, dtype=torch.float64, requires_grad=True)
    moved = move(X_noisy, delta, LENGTH_M)
    p_error = (moved[:, :3, 3] - X[:, :3, 3]) / LENGTH_M
    angle = so3_log(X[:, :3, :3].transpose(-1, -2) @ moved[:, :3, :3])
    log_density = -(p_error.square().sum() + angle.square().sum()) / (2.0 * sigma**2)
    (gradient,) = torch.autograd.grad(log_density, delta)
    target = target_score(X, X_noisy, sigmas, LENGTH_M)
    relative = (target - sigma * gradient).norm(dim=-1) / target.norm(dim=-1)
    assert relative.max() < 1e-6


def test_a_step_along_the_target_leads_back_to_the_pose() -> None:
    generator = torch.Generator().manual_seed(1)
    X = random_poses(50, generator)
    sigma = torch.full((50,), 1.5, dtype=torch.float64)
    X_noisy = perturb(X, sigma, LENGTH_M, generator)
    step = sigma[:, None] * target_score(X, X_noisy, sigma, LENGTH_M)
    assert torch.allclose(move(X_noisy, step, LENGTH_M), X, atol=1e-6)


def test_perturbation_has_the_standard_deviation_asked_for() -> None:
    generator = torch.Generator().manual_seed(2)
    X = random_poses(1, generator).expand(20000, 4, 4)
    noisy = perturb(X, torch.full((20000,), 0.2), LENGTH_M, generator)
    deviation = displacement(X, noisy, LENGTH_M).std(0)
    assert torch.allclose(deviation, torch.full_like(deviation, 0.2), rtol=0.03)


def test_schedule_is_geometric_and_descends() -> None:
    schedule = NoiseSchedule(sigma_min=0.01, sigma_max=1.0)
    assert schedule.descending(3) == pytest.approx([1.0, 0.1, 0.01])


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (0.5, 0.5), (-1.0, 1.0)])
def test_impossible_schedules_are_errors(bounds: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=f"sigma_min={bounds[0]}"):
        NoiseSchedule(sigma_min=bounds[0], sigma_max=bounds[1])


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: LangevinConfig(steps=0), "steps=0"),
        (lambda: LangevinConfig(temperature=-1.0), "temperature is -1"),
        (lambda: LangevinConfig(final_steps=-1), "final_steps=-1"),
    ],
)
def test_impossible_dynamics_are_errors(make: Callable[[], LangevinConfig], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        make()


def two_poses() -> Tensor:
    """Return two targets (2, 4, 4), 6 cm and a right angle apart."""
    p = torch.tensor([[0.10, 0.15, 0.10], [0.16, 0.15, 0.10]])
    return compose(so3_exp(torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, torch.pi / 2]])), p)


def mixture_score(X: Tensor, sigma: float) -> Tensor:
    """Return sigma * score (N, 6) of the two targets, perturbed, at the poses (N, 4, 4)."""
    targets = two_poses()[:, None].expand(-1, len(X), -1, -1)
    sigmas = torch.full((2, len(X)), sigma)
    scores = target_score(targets, X.expand(2, -1, -1, -1), sigmas, LENGTH_M)
    weights = torch.softmax(-0.5 * scores.square().sum(-1), 0)
    return (weights[..., None] * scores).sum(0)


LANGEVIN = LangevinConfig()
# Integrators, and how many evaluations of the score each of them takes.
INTEGRATORS: dict[str, tuple[Integrator, int]] = {
    "langevin": (
        partial(annealed_langevin, config=LANGEVIN),
        LANGEVIN.steps + LANGEVIN.final_steps,
    ),
    "heun": (partial(heun, steps=8), 15),
    "multistep": (partial(multistep, steps=15), 15),
    "predictor_corrector": (partial(predictor_corrector, steps=8, temperature=0.2), 15),
}
every_integrator = pytest.mark.parametrize("name", INTEGRATORS)


def inside(p_VPs: Tensor) -> Tensor:
    """Return positions clamped to a cube of 0.3 m."""
    return p_VPs.clamp(0.0, 0.3)


@dataclass
class Watched:
    """A score function and a callback that count.

    Attributes:
        evaluations: of the score.
        steps, poses: that the callback was called with.
    """

    score_of: ScoreFunction = mixture_score
    evaluations: int = 0
    steps: list[int] = field(default_factory=list)
    poses: list[Tensor] = field(default_factory=list)

    def score(self, X: Tensor, sigma: float) -> Tensor:
        self.evaluations += 1
        return self.score_of(X, sigma)

    def callback(self, step: int, X: Tensor) -> None:
        self.steps.append(step)
        self.poses.append(X.clone())


def sample_mixture(name: str, seed: int, watched: Watched | None = None) -> Tensor:
    """Return 200 samples of the mixture (200, 4, 4) by an integrator."""
    watched = watched or Watched()
    generator = torch.Generator().manual_seed(seed)
    start = random_poses(200, generator).float()
    integrate, _ = INTEGRATORS[name]
    schedule = NoiseSchedule(length_m=LENGTH_M)
    return integrate(
        ReverseDiffusion(watched.score, schedule, generator, inside, watched.callback), start
    )


@every_integrator
def test_samplers_reach_both_modes_of_a_known_density(name: str) -> None:
    samples = sample_mixture(name, 0).expand(2, -1, -1, -1)
    targets = two_poses()[:, None].expand(-1, 200, -1, -1)
    distance = displacement(targets, samples, LENGTH_M).norm(dim=-1)
    assert distance.min(0).values.max() < 0.05
    share_first = (distance[0] < distance[1]).float().mean().item()
    assert 0.2 < share_first < 0.8


@every_integrator
def test_samplers_depend_on_nothing_but_the_generator(name: str) -> None:
    assert torch.equal(sample_mixture(name, 4), sample_mixture(name, 4))
    assert not torch.equal(sample_mixture(name, 4), sample_mixture(name, 5))


@every_integrator
def test_callback_sees_every_step_and_the_result(name: str) -> None:
    watched = Watched()
    samples = sample_mixture(name, 0, watched)
    assert watched.steps == list(range(len(watched.steps)))
    assert watched.evaluations == INTEGRATORS[name][1]
    assert torch.equal(watched.poses[-1], samples)
    assert not torch.equal(watched.poses[0], samples)


@every_integrator
def test_positions_are_confined(name: str) -> None:
    watched = Watched(lambda X, sigma: torch.full((*X.shape[:-2], 6), -5.0))
    sample_mixture(name, 0, watched)
    assert min(X[..., :3, 3].min().item() for X in watched.poses) == 0.0


def gaussian_score(X: Tensor, sigma: float) -> Tensor:
    """Return sigma * score (N, 6) of one pose perturbed by 0.3, and then by sigma."""
    target = two_poses()[1].double().expand(len(X), 4, 4)
    spread = torch.full((len(X),), (0.3**2 + sigma**2) ** 0.5, dtype=torch.float64)
    return target_score(target, X, spread, LENGTH_M) * sigma / spread[:, None]


def flow_error(integrate: Integrator) -> float:
    """Return how far the integrator ends from the probability flow's exact solution.

    That is straight towards the pose, at a distance in proportion to the density's spread.
    """
    schedule = NoiseSchedule(sigma_min=0.01, sigma_max=1.0)
    generator = torch.Generator().manual_seed(0)
    target = two_poses()[1].double().expand(100, 4, 4)
    start = perturb(target, torch.full((100,), 0.8, dtype=torch.float64), LENGTH_M, generator)
    share = 0.3 / (0.3**2 + 1.0) ** 0.5
    R_target, p_target = target[:, :3, :3], target[:, :3, 3]
    turn = so3_exp(share * so3_log(R_target.mT @ start[:, :3, :3]))
    exact = compose(R_target @ turn, p_target + share * (start[:, :3, 3] - p_target))
    end = integrate(ReverseDiffusion(gaussian_score, schedule, generator, lambda p: p), start)
    return displacement(exact, end, LENGTH_M).norm(dim=-1).max().item()


@pytest.mark.parametrize("method", [heun, multistep])
def test_flow_is_integrated_to_second_order(method: Callable[..., Tensor]) -> None:
    coarse, fine = (flow_error(partial(method, steps=steps)) for steps in (10, 20))
    assert fine < coarse / 3.0
    assert fine < 0.01


@pytest.mark.parametrize("final_sigma", [0.01, 2.0])
def test_final_steps_outside_the_schedule_are_an_error(final_sigma: float) -> None:
    generator = torch.Generator().manual_seed(0)
    start = random_poses(1, generator).float()
    config = LangevinConfig(final_sigma=final_sigma)
    with pytest.raises(ValueError, match=f"final_sigma is {final_sigma}; .* from 0.03 to 1.5"):
        annealed_langevin(
            ReverseDiffusion(mixture_score, NoiseSchedule(), generator, inside),
            start,
            config=config,
        )
