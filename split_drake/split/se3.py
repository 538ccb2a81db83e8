"""Rotations and poses as tensors: exponential, logarithm, composition, uniform sampling.

Formulas and names follow Sola's "A micro Lie theory", as the paper does (section III-B).  Functions
take any batch shape and keep the type and device of their argument.
"""

import torch
from torch import Tensor


def hat(omega: Tensor) -> Tensor:
    """Return the skew matrices (..., 3, 3) with ``hat(a) @ b = a x b``."""
    x, y, z = omega.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))


def _sinc(angle: Tensor) -> Tensor:
    """Return sin(angle) / angle, 1 at zero."""
    return torch.sinc(angle / torch.pi)


def so3_exp(omega: Tensor) -> Tensor:
    """Return rotations (..., 3, 3) by the rotation vectors `omega` (..., 3) (Rodrigues)."""
    angle = torch.linalg.vector_norm(omega, dim=-1)[..., None, None]
    K = hat(omega)
    identity = torch.eye(3, dtype=omega.dtype, device=omega.device)
    return identity + _sinc(angle) * K + 0.5 * _sinc(angle / 2.0) ** 2 * (K @ K)


def _quaternions(R: Tensor) -> Tensor:
    """Return unit quaternions [w, x, y, z] with w >= 0 for rotations (..., 3, 3).

    The largest component is divided by (Shepperd's method), so that no angle is special.
    """
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    squares = torch.stack([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz])
    wx, wy, wz = (R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    xy, xz, yz = (R[..., i, j] + R[..., j, i] for i, j in ((1, 0), (0, 2), (2, 1)))
    candidates = torch.stack(
        [
            torch.stack([squares[0], wx, wy, wz], -1),
            torch.stack([wx, squares[1], xy, xz], -1),
            torch.stack([wy, xy, squares[2], yz], -1),
            torch.stack([wz, xz, yz, squares[3]], -1),
        ]
    )
    best = squares.argmax(0)[None, ..., None].expand(1, *R.shape[:-2], 4)
    q = torch.nn.functional.normalize(candidates.gather(0, best)[0], dim=-1)
    return torch.where(q[..., :1] < 0, -q, q)


def so3_log(R: Tensor) -> Tensor:
    """Return rotation vectors (..., 3) of length at most pi for rotations (..., 3, 3)."""
    q = _quaternions(R)
    w, v = q[..., :1], q[..., 1:]
    length = torch.linalg.vector_norm(v, dim=-1, keepdim=True)
    tiny = length < 1e-6
    ratio = 2.0 * torch.atan2(length, w) / torch.where(tiny, torch.ones_like(length), length)
    return v * torch.where(tiny, torch.full_like(ratio, 2.0), ratio)


def compose(R: Tensor, p: Tensor) -> Tensor:
    """Return poses (..., 4, 4) with rotations `R` (..., 3, 3) and translations `p` (..., 3)."""
    X = R.new_zeros((*R.shape[:-2], 4, 4))
    X[..., :3, :3] = R
    X[..., :3, 3] = p
    X[..., 3, 3] = 1.0
    return X


def uniform_rotations(shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    """Return rotations (*shape, 3, 3), uniform on SO(3), from normal quaternions."""
    q = torch.randn((*shape, 4), generator=generator, device=generator.device)
    q = q / torch.linalg.vector_norm(q, dim=-1, keepdim=True)
    w, v = q[..., :1], q[..., 1:]
    K = hat(v)
    return torch.eye(3, device=q.device) + 2.0 * w[..., None] * K + 2.0 * (K @ K)
