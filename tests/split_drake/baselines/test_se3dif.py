"""SE(3)-DiffusionFields: what turns with what, its noise, and what it is trained to."""

import numpy as np
import pytest
import torch
from torch import Tensor

from split_drake.baselines.se3dif import diffusion
from split_drake.baselines.se3dif.clouds import drawn_points, scaled_cloud
from split_drake.baselines.se3dif.detector import Se3DifDetector
from split_drake.baselines.se3dif.diffusion import Se3DifSampler, denoising_loss, sigma
from split_drake.baselines.se3dif.network import CLOUD_POINTS, Se3DifNetwork
from split_drake.baselines.se3dif.vector_neurons import VectorEncoder
from split_drake.scene import Scene
from split_drake.split.se3 import so3_exp, so3_log, uniform_rotations
from split_drake.station.layout import Layout
from tests.split_drake.baselines.table_views import side_view, views

FEW = Se3DifSampler(samples=6, steps=4, still_steps=2)


@pytest.fixture(scope="module")
def network() -> Se3DifNetwork:
    torch.manual_seed(0)
    return Se3DifNetwork()


def test_codes_turn_with_the_cloud() -> None:
    torch.manual_seed(0)
    encoder = VectorEncoder(12).double()
    generator = torch.Generator().manual_seed(1)
    points = torch.randn(2, 60, 3, generator=generator, dtype=torch.float64)
    turn = so3_exp(torch.tensor([0.3, -0.8, 1.1], dtype=torch.float64))
    code, turned = encoder(points), encoder(points @ turn.T)
    expected = code.unflatten(1, (4, 3)) @ turn.T
    torch.testing.assert_close(turned.unflatten(1, (4, 3)), expected, rtol=1e-6, atol=1e-9)


def test_the_network_is_as_large_as_the_papers(network: Se3DifNetwork) -> None:
    count = sum(each.numel() for each in network.parameters())
    assert 2.2e6 < count < 2.5e6, "which is 10 MB at most"


def test_the_gradient_is_that_of_small_motions(network: Se3DifNetwork) -> None:
    exact = Se3DifNetwork().double()
    exact.load_state_dict(network.state_dict())
    generator = torch.Generator().manual_seed(2)
    R = uniform_rotations((1,), generator).double()
    p = torch.randn(1, 3, generator=generator).double()
    code = torch.randn(1, 132, generator=generator).double()
    time = torch.tensor([0.3], dtype=torch.float64)
    _, gradient = exact.energy_gradient(code, R, p, time)
    step = 1e-6
    for axis in range(6):
        delta = torch.zeros(1, 6, dtype=torch.float64)
        delta[0, axis] = step
        ends: list[Tensor] = [
            exact.energy(code, so3_exp(sign * delta[:, 3:]) @ R, p + sign * delta[:, :3], time)
            for sign in (1.0, -1.0)
        ]
        numeric = (ends[0] - ends[1]) / (2.0 * step)
        assert gradient[0, axis].item() == pytest.approx(numeric.item(), abs=1e-6)


def test_noise_rises_from_0_032_to_0_74() -> None:
    found = sigma(torch.tensor([diffusion.FIRST_TIME, 1.0]))
    assert found.tolist() == pytest.approx([0.0316, 0.7355], abs=1e-3)
    assert (sigma(torch.linspace(0.0, 1.0, 20)).diff() > 0.0).all()


class Bowl(torch.nn.Module):
    """An energy whose gradient is the noise over its variance, of one grasp at the origin."""

    def energy_gradient(
        self, code: Tensor, R: Tensor, p: Tensor, time: Tensor, training: bool = False
    ) -> tuple[Tensor, Tensor]:
        off = torch.cat([p, so3_log(R)], -1)
        squared = sigma(time)[:, None] ** 2
        return (off.square() / (2.0 * squared)).sum(-1), off / squared


def test_the_sampler_finds_the_grasp_of_a_true_energy() -> None:
    bowl: Se3DifNetwork = Bowl()  # type: ignore[assignment]
    generator = torch.Generator().manual_seed(0)
    R, p, energy = Se3DifSampler(samples=40).draw(bowl, torch.zeros(1, 132), generator)
    angles = torch.arccos(((R.diagonal(dim1=-2, dim2=-1).sum(-1) - 1.0) / 2.0).clamp(-1.0, 1.0))
    assert p.norm(dim=-1).max() < 1e-3
    assert (angles < 0.02).all()
    assert energy.shape == (40,)


def test_the_loss_is_least_where_the_gradient_is_the_noise() -> None:
    bowl: Se3DifNetwork = Bowl()  # type: ignore[assignment]
    generator = torch.Generator().manual_seed(0)
    R, p = torch.eye(3).expand(500, 3, 3), torch.zeros(500, 3)
    # Noise of more than half a turn comes back from the other side.
    assert denoising_loss(bowl, torch.zeros(500, 132), R, p, generator) < 0.01
    worse = denoising_loss(bowl, torch.zeros(500, 132), R, p + 1.0, generator)
    assert worse > 0.1


def test_clouds_are_about_their_middle_and_scaled() -> None:
    points = torch.tensor([[0.4, 0.1, 0.0], [0.6, 0.1, 0.2]])
    cloud, middle = scaled_cloud(points)
    assert middle.tolist() == pytest.approx([0.5, 0.1, 0.1])
    assert cloud[1].tolist() == pytest.approx([0.8, 0.0, 0.8])
    generator = torch.Generator().manual_seed(0)
    assert len(drawn_points(points, 7, generator)) == 7
    many = torch.arange(30.0).reshape(10, 3)
    assert len(torch.unique(drawn_points(many, 10, generator), dim=0)) == 10


def test_whole_scenes_and_segments_are_looked_at(network: Se3DifNetwork) -> None:
    seen = views((1, 0.43, -0.05), (3, 0.57, 0.06), cameras=[side_view()])
    scene = Scene.from_views(seen, Layout().workspace)
    found = {}
    for segments in (False, True):
        detector = Se3DifDetector(network, segments, FEW)
        found[segments] = detector.detect(scene, ["grasp"], np.random.default_rng(0))["grasp"]
        again = detector.detect(scene, ["grasp"], np.random.default_rng(0))["grasp"]
        assert np.array_equal(found[segments].X_WPs, again.X_WPs)
        assert len(found[segments]) <= FEW.samples


def test_bfloat16_leaves_the_grasps_where_they_are(network: Se3DifNetwork) -> None:
    seen = views((1, 0.43, -0.05), cameras=[side_view()])
    scene = Scene.from_views(seen, Layout().workspace)
    exact, rounded = (
        Se3DifDetector(network, False, FEW, each).detect(scene, ["grasp"], np.random.default_rng(0))
        for each in (False, True)
    )
    assert not np.array_equal(exact["grasp"].X_WPs, rounded["grasp"].X_WPs)
    assert len(exact["grasp"]) == len(rounded["grasp"])
    # Nearly equal scores may change places.
    order, other = (np.argsort(each["grasp"].X_WPs[:, 0, 3]) for each in (exact, rounded))
    np.testing.assert_allclose(
        exact["grasp"].X_WPs[order], rounded["grasp"].X_WPs[other], atol=2e-3
    )


def test_counts_of_the_sampler_are_checked() -> None:
    with pytest.raises(ValueError, match="samples=0, steps=1, still_steps=0; expected one or more"):
        Se3DifSampler(0, 1, 0)
    with pytest.raises(ValueError, match="still_steps=-1"):
        Se3DifSampler(1, 1, -1)


def test_bfloat16_leaves_the_loss_and_nearly_its_gradient() -> None:
    torch.manual_seed(0)
    network = Se3DifNetwork()
    points, p = torch.randn(1, CLOUD_POINTS, 3), torch.randn(8, 3)
    R = uniform_rotations((8,), torch.Generator().manual_seed(1))
    losses, gradients = [], []
    for network.in_bfloat16 in (False, True):
        network.zero_grad()
        code = network.encode(points).expand(8, -1)
        assert code.dtype == torch.float32
        loss = denoising_loss(network, code, R, p, torch.Generator().manual_seed(2))
        loss.backward()
        losses.append(loss.item())
        grads = [each.grad for each in network.parameters() if each.grad is not None]
        gradients.append(torch.cat([each.flatten() for each in grads]))
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)
    exact, rounded = gradients
    assert not torch.equal(exact, rounded)
    assert torch.cosine_similarity(exact, rounded, dim=0) > 0.98
