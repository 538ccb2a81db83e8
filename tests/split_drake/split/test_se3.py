"""Exponential and logarithm of SO(3), poses as a group: small angles, angles near pi."""

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


# Small angles, on either side of the logarithm's change of formula too, and angles up to pi.
ANGLES_RAD = [0.0, 1e-12, 1e-7, 1.9e-6, 2.1e-6, 1e-4, 0.3, 1.0, 2.0, 3.0, 3.14, torch.pi - 1e-9]


@pytest.mark.parametrize("angle_rad", ANGLES_RAD)
def test_logarithm_inverts_exponential_of_rotations(angle_rad: float) -> None:
    omega = random_vectors(50, angle_rad)
    assert torch.allclose(se3.so3_log(se3.so3_exp(omega)), omega, atol=2e-7, rtol=0)


def test_exponential_matches_the_matrix_exponential() -> None:
    generator = torch.Generator().manual_seed(3)
    omega = 2.0 * torch.randn(100, 3, generator=generator, dtype=torch.float64)
    expected = torch.linalg.matrix_exp(se3.hat(omega))
    assert torch.allclose(se3.so3_exp(omega), expected, atol=1e-10)


def test_rotation_vectors_longer_than_pi_come_back_as_the_shorter_turn() -> None:
    omega = random_vectors(20, 4.0)
    expected = omega * (4.0 - 2.0 * torch.pi) / 4.0
    assert torch.allclose(se3.so3_log(se3.so3_exp(omega)), expected, atol=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_half_turn_has_a_logarithm_of_length_pi(axis: int) -> None:
    R = -torch.eye(3)
    R[axis, axis] = 1.0
    assert se3.so3_log(R).abs()[axis].item() == pytest.approx(torch.pi, abs=1e-6)


VECTORS = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)


@settings(max_examples=50)
@given(VECTORS)
def test_opposite_rotation_vectors_are_inverse_rotations(values: list[float]) -> None:
    omega = torch.tensor(values, dtype=torch.float64)
    product = se3.so3_exp(omega) @ se3.so3_exp(-omega)
    assert torch.allclose(product, torch.eye(3, dtype=torch.float64), atol=1e-12)


@settings(max_examples=50)
@given(VECTORS, VECTORS, VECTORS, VECTORS)
def test_poses_are_a_group(
    omega_1: list[float], p_1: list[float], omega_2: list[float], p_2: list[float]
) -> None:
    """The product of poses is the pose of the product, and its inverse is that of rigid motions."""
    R_1, R_2 = (se3.so3_exp(torch.tensor(w, dtype=torch.float64)) for w in (omega_1, omega_2))
    t_1, t_2 = (torch.tensor(p, dtype=torch.float64) for p in (p_1, p_2))
    product = se3.compose(R_1, t_1) @ se3.compose(R_2, t_2)
    assert torch.allclose(product, se3.compose(R_1 @ R_2, R_1 @ t_2 + t_1), atol=1e-12)
    inverse = se3.compose(R_1.T, -R_1.T @ t_1)
    identity = torch.eye(4, dtype=torch.float64)
    assert torch.allclose(se3.compose(R_1, t_1) @ inverse, identity, atol=1e-12)


@settings(max_examples=50)
@given(VECTORS, VECTORS)
def test_conjugation_turns_the_rotation_vector(omega: list[float], turn: list[float]) -> None:
    """R Exp(w) R^T = Exp(R w): the adjoint of SO(3)."""
    w, R = (torch.tensor(v, dtype=torch.float64) for v in (omega, turn))
    R = se3.so3_exp(R)
    assert torch.allclose(R @ se3.so3_exp(w) @ R.T, se3.so3_exp(R @ w), atol=1e-12)


def test_float32_keeps_its_precision_at_small_angles() -> None:
    omega = random_vectors(50, 1e-3).float()
    error = (se3.so3_log(se3.so3_exp(omega)) - omega).norm(dim=-1)
    assert error.max() < 2e-7


def test_batch_shapes_are_kept() -> None:
    R = se3.so3_exp(torch.zeros(2, 5, 3))
    assert R.shape == (2, 5, 3, 3)
    assert se3.so3_log(R).shape == (2, 5, 3)
    assert se3.compose(R, torch.zeros(2, 5, 3)).shape == (2, 5, 4, 4)
    assert se3.so3_log(torch.eye(3)).shape == (3,)


def test_gradient_of_exponential_is_that_of_hat_at_zero() -> None:
    omega = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    se3.so3_exp(omega)[1, 0].backward()
    assert omega.grad is not None
    assert omega.grad.tolist() == [0.0, 0.0, 1.0]


def test_uniform_rotations_are_rotations_without_a_preferred_direction() -> None:
    R = se3.uniform_rotations((20000,), torch.Generator().manual_seed(0))
    assert torch.allclose(R @ R.transpose(-1, -2), torch.eye(3).expand_as(R), atol=1e-5)
    assert torch.allclose(torch.linalg.det(R), torch.ones(len(R)), atol=1e-5)
    assert R.mean(0).abs().max() < 0.02
    # The angle's density on SO(3) is (1 - cos a) / pi, whose mean is pi/2 + 2/pi.
    angle = torch.linalg.vector_norm(se3.so3_log(R), dim=-1)
    assert angle.mean().item() == pytest.approx(torch.pi / 2 + 2 / torch.pi, abs=0.02)
