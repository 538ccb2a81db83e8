"""Exponential and logarithm of SO(3) and SE(3): group axioms, small angles, angles near pi."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from split_drake.split import se3


def random_vectors(count: int, length: float, seed: int = 0) -> Tensor:
    """Return (count, 3) float64 vectors of the given length in random directions."""
    directions = torch.randn(
        count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64
    )
    return length * torch.nn.functional.normalize(directions, dim=-1)


# Small angles, an angle on either side of each change of formula, and angles up to pi.
ANGLES_RAD = [0.0, 1e-12, 1e-7, 1e-4, 0.29, 0.31, 1.0, 2.0, 3.0, 3.14, torch.pi - 1e-9]


@pytest.mark.parametrize("angle_rad", ANGLES_RAD)
def test_logarithm_inverts_exponential_of_rotations(angle_rad: float) -> None:
    omega = random_vectors(50, angle_rad)
    assert torch.allclose(se3.so3_log(se3.so3_exp(omega)), omega, atol=2e-7, rtol=0)


@pytest.mark.parametrize("angle_rad", ANGLES_RAD)
def test_logarithm_inverts_exponential_of_motions(angle_rad: float) -> None:
    xi = torch.cat([random_vectors(50, 0.7, seed=1), random_vectors(50, angle_rad)], -1)
    assert torch.allclose(se3.se3_log(se3.se3_exp(xi)), xi, atol=1e-6, rtol=0)


def test_exponential_matches_the_matrix_exponential() -> None:
    generator = torch.Generator().manual_seed(3)
    xi = 2.0 * torch.randn(100, 6, generator=generator, dtype=torch.float64)
    algebra = torch.zeros(100, 4, 4, dtype=torch.float64)
    algebra[:, :3, :3] = se3.hat(xi[:, 3:])
    algebra[:, :3, 3] = xi[:, :3]
    assert torch.allclose(se3.se3_exp(xi), torch.linalg.matrix_exp(algebra), atol=1e-10)


def test_rotation_vectors_longer_than_pi_come_back_as_the_shorter_turn() -> None:
    omega = random_vectors(20, 4.0)
    expected = omega * (4.0 - 2.0 * torch.pi) / 4.0
    assert torch.allclose(se3.so3_log(se3.so3_exp(omega)), expected, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_half_turn_has_a_logarithm_of_length_pi(axis: int) -> None:
    R = -torch.eye(3)
    R[axis, axis] = 1.0
    assert se3.so3_log(R).abs()[axis].item() == pytest.approx(torch.pi, abs=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_opposite_tangent_vectors_are_inverse_motions(values: list[float]) -> None:
    xi = torch.tensor(values, dtype=torch.float64)
    product = se3.se3_exp(xi) @ se3.se3_exp(-xi)
    assert torch.allclose(product, torch.eye(4, dtype=torch.float64), atol=1e-10)


def test_float32_keeps_its_precision_at_small_angles() -> None:
    omega = random_vectors(50, 1e-3).float()
    error = (se3.so3_log(se3.so3_exp(omega)) - omega).norm(dim=-1)
    assert error.max() < 2e-7


def test_batch_shapes_are_kept() -> None:
    xi = torch.zeros(2, 5, 6)
    assert se3.se3_exp(xi).shape == (2, 5, 4, 4)
    assert se3.se3_log(se3.se3_exp(xi)).shape == (2, 5, 6)
    assert se3.so3_log(torch.eye(3)).shape == (3,)


def test_gradient_of_exponential_is_finite_at_zero() -> None:
    xi = torch.zeros(6, dtype=torch.float64, requires_grad=True)
    se3.se3_exp(xi)[0, 3].backward()
    assert xi.grad is not None
    assert xi.grad.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def test_uniform_rotations_are_rotations_without_a_preferred_direction() -> None:
    R = se3.uniform_rotations((20000,), torch.Generator().manual_seed(0))
    assert torch.allclose(R @ R.transpose(-1, -2), torch.eye(3).expand_as(R), atol=1e-5)
    assert torch.allclose(torch.linalg.det(R), torch.ones(len(R)), atol=1e-5)
    assert R.mean(0).abs().max() < 0.02
    # The angle's density on SO(3) is (1 - cos a) / pi, whose mean is pi/2 + 2/pi.
    angle = torch.linalg.vector_norm(se3.so3_log(R), dim=-1)
    assert angle.mean().item() == pytest.approx(torch.pi / 2 + 2 / torch.pi, abs=0.02)


def test_spatial_vectors_put_the_rotation_first() -> None:
    assert se3.to_spatial_vector(torch.arange(6)).tolist() == [3, 4, 5, 0, 1, 2]
