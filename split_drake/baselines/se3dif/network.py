"""The energy of a gripper's pose beside an object (arXiv 2209.03855, section IV and appendix).

A code stands for the cloud.  Points that are fixed in the gripper are moved by the pose; each gets
features of code, place and time, and one more network makes an energy of all of them.  Lengths are
in units in which the cloud is `SCALE` times as large as in metres.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from split_drake.baselines.se3dif.vector_neurons import VectorEncoder
from split_drake.split.se3 import hat

SCALE = 8.0
CLOUD_POINTS = 1000
LATENT = 132
GRIPPER_POINTS = 30
POINT_FEATURES = 7
WIDTH, LAYERS, JOINED_AGAIN = 512, 8, 4
TIME_FEATURES = 64
# The box that the gripper's points fill, in our frame G, metres: its jaw, and the palm behind.
BOX_LOWER_M, BOX_UPPER_M = (-0.031, -0.044, -0.075), (0.031, 0.044, 0.013)


class Se3DifNetwork(nn.Module):
    """Code of a cloud, and the energy of poses beside it.

    Attributes:
        in_bfloat16: whether products of features are computed in that type.
    """

    in_bfloat16: bool = False
    p_GQs: Tensor
    frequencies: Tensor

    def __init__(self) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(0)
        low, high = torch.tensor(BOX_LOWER_M), torch.tensor(BOX_UPPER_M)
        spread = torch.rand(GRIPPER_POINTS, 3, generator=generator)
        self.register_buffer("p_GQs", SCALE * (low + (high - low) * spread))
        # Fourier features of time (Tancik et al. 2020, arXiv 2006.10739).
        waves = 2.0 * math.pi * 30.0 * torch.randn(TIME_FEATURES // 2, generator=generator)
        self.register_buffer("frequencies", waves)
        self.encoder = VectorEncoder(LATENT)
        self.of_time = nn.Linear(TIME_FEATURES, TIME_FEATURES)
        self.of_points = PointFeatures(LATENT + 3 + TIME_FEATURES)
        self.to_energy = nn.Sequential(
            nn.Linear(GRIPPER_POINTS * POINT_FEATURES, WIDTH), nn.ReLU(), nn.Linear(WIDTH, 1)
        )

    def encode(self, points: Tensor) -> Tensor:
        """Return codes (B, LATENT) of clouds (B, N, 3), about their middle and scaled."""
        with self._products():
            code: Tensor = self.encoder(points)
        return code.to(points.dtype)

    def _products(self) -> torch.autocast:
        """Return within what products of features are computed; places keep all their digits."""
        device = self.p_GQs.device.type
        return torch.autocast(device, torch.bfloat16, enabled=self.in_bfloat16)

    def energy(self, code: Tensor, R: Tensor, p: Tensor, time: Tensor) -> Tensor:
        """Return energies (P,) of poses with rotations (P, 3, 3) and scaled positions (P, 3).

        Args:
            code: (P, LATENT) of the cloud that each is beside.
            time: (P,) in (0, 1] of the diffusion.
        """
        waves = time[:, None] * self.frequencies
        at = self.of_time(torch.cat([waves.sin(), waves.cos()], -1))
        points = self.p_GQs @ R.transpose(-1, -2) + p[:, None]
        same = torch.cat([code, functional.silu(at)], -1)[:, None].expand(-1, GRIPPER_POINTS, -1)
        with self._products():
            features = self.of_points(torch.cat([same, points], -1))
            energy: Tensor = self.to_energy(features.flatten(1))
        return energy[:, 0].to(R.dtype)

    def energy_gradient(
        self, code: Tensor, R: Tensor, p: Tensor, time: Tensor, training: bool = False
    ) -> tuple[Tensor, Tensor]:
        """Return energies (P,) and their gradients (P, 6), position first, in the world's axes.

        That is the gradient by v and w of the energy at Exp(w) R and p + v, at 0.  In `training`
        it can be differentiated itself.
        """
        with torch.enable_grad():
            moved = R.new_zeros(len(R), 6, requires_grad=True)
            # At 0 the exponential's derivative is that of its first term.
            turned = R + hat(moved[:, 3:]) @ R
            energy = self.energy(code, turned, p + moved[:, :3], time)
            (gradient,) = torch.autograd.grad(energy.sum(), moved, create_graph=training)
        return energy, gradient


class PointFeatures(nn.Module):
    """Eight layers of 512, the input joined again halfway, as in DeepSDF (arXiv 1901.05103)."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        sizes = [inputs, *[WIDTH] * LAYERS]
        sizes[JOINED_AGAIN] += inputs
        outputs = [*[WIDTH] * LAYERS, POINT_FEATURES]
        self.layers = nn.ModuleList(
            nn.Linear(size, output) for size, output in zip(sizes, outputs, strict=True)
        )

    def forward(self, given: Tensor) -> Tensor:
        """Return features (..., 7) of what is given (..., inputs)."""
        state = given
        for number, layer in enumerate(self.layers):
            if number == JOINED_AGAIN:
                state = torch.cat([state, given], -1)
            state = layer(state)
            if number < LAYERS:
                state = functional.relu(state)
        return state
