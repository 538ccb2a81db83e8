"""The networks beside the same layers taken one by one from the state dictionary.

That is done with the parameters that the authors published, where they are there, and with new
ones.  The field is a stored one: two solids on a table, seen from the side.
"""

from collections.abc import Mapping
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from split_drake.baselines.giga.network import GigaNetwork
from split_drake.baselines.published import load_published
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.station.layout import Layout
from tests.split_drake.baselines.table_views import side_view, views

PUBLISHED = Path(__file__).parents[4] / "shared/peer_weights"
Parameters = Mapping[str, Tensor]


@pytest.fixture(scope="module")
def field() -> Tensor:
    """Return a TSDF (1, 40, 40, 40)."""
    seen = views((1, 0.45, 0.0), (3, 0.55, 0.05), cameras=[side_view()])
    return torch.tensor(fused_tsdf(seen, Layout().workspace))[None]


def given(network: nn.Module, name: str) -> nn.Module:
    """Return the network with the parameters of that file, or with new ones where it is "new"."""
    torch.manual_seed(0)
    if name == "new":
        return network
    if not (PUBLISHED / name).is_file():
        pytest.skip(f"the authors' weights are not at {PUBLISHED / name}")
    return load_published(network, PUBLISHED / name)


def vgn_by_layers(values: Parameters, field: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return quality, quaternion and width of every voxel (arXiv 2101.01132, figure 3)."""

    def convolved(name: str, x: Tensor, kernel: int, stride: int = 1) -> Tensor:
        weight, bias = values[f"{name}.weight"], values[f"{name}.bias"]
        return functional.conv3d(x, weight, bias, stride=stride, padding=kernel // 2)

    x = field[:, None]
    for number, kernel in enumerate((5, 3, 3), start=1):
        x = convolved(f"encoder.conv{number}", x, kernel, stride=2).relu()
    for number, (kernel, size) in enumerate(((3, 10), (3, 20), (5, 40)), start=1):
        x = convolved(f"decoder.conv{number}", x, kernel).relu()
        factor = size // x.shape[-1]
        for axis in (2, 3, 4):  # nearest neighbours
            x = x.repeat_interleave(factor, axis)
    rotation = convolved("conv_rot", x, 5)
    return (
        convolved("conv_qual", x, 5).sigmoid()[:, 0],
        (rotation / rotation.norm(dim=1, keepdim=True)).movedim(1, -1),
        convolved("conv_width", x, 5)[:, 0],
    )


@pytest.mark.parametrize("name", ["new", "vgn_packed.pt", "vgn_pile.pt"])
def test_vgn_is_its_layers(name: str, field: Tensor) -> None:
    network = given(VgnNetwork(), name)
    with torch.inference_mode():
        for found, expected in zip(
            network(field), vgn_by_layers(network.state_dict(), field), strict=True
        ):
            torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


class GigaByLayers:
    """GIGA, taken from its state dictionary: planes voxel by voxel, decoders point by point."""

    def __init__(self, values: Parameters, field: Tensor) -> None:
        self._values = values
        weight, bias = values["encoder.conv_in.weight"], values["encoder.conv_in.bias"]
        voxels = functional.conv3d(field[:, None], weight, bias, padding=1).relu()[0]
        line = torch.linspace(-0.5, 0.5, 40)
        places = torch.stack(torch.meshgrid(line, line, line, indexing="ij"), -1)
        cells = (self.normalized(places) * 40).long()
        # Of xz, xy and yz the first axis is that of a plane's columns.
        self._planes = {
            axes: self._unet(self._mean(voxels, cells[..., list(axes)]))
            for axes in ((0, 2), (0, 1), (1, 2))
        }

    @staticmethod
    def normalized(places: Tensor) -> Tensor:
        """Return places of [-0.5, 0.5] in [0, 1), as convolutional occupancy networks do."""
        return (places / (1.0 + 1e-5) + 0.5).clamp(0.0, 1.0 - 1e-5)

    @staticmethod
    def _mean(voxels: Tensor, cells: Tensor) -> Tensor:
        sums, counts = torch.zeros(32, 40, 40), torch.zeros(40, 40)
        column, row = cells.reshape(-1, 2).unbind(-1)
        counts.index_put_((row, column), torch.ones(len(row)), accumulate=True)
        for channel, values in enumerate(voxels.reshape(32, -1)):
            sums[channel].index_put_((row, column), values, accumulate=True)
        return sums / counts.clamp(min=1.0)

    def _convolved(self, name: str, x: Tensor, padding: int) -> Tensor:
        weight, bias = self._values[f"{name}.weight"], self._values[f"{name}.bias"]
        return functional.conv2d(x, weight, bias, padding=padding)

    def _unet(self, plane: Tensor) -> Tensor:
        base, x, across = "encoder.unet", plane[None], []
        for level in range(3):
            for convolution in ("conv1", "conv2"):
                x = self._convolved(f"{base}.down_convs.{level}.{convolution}", x, 1).relu()
            across.append(x)
            if level < 2:
                x = functional.max_pool2d(x, 2)
        for level in range(2):
            name = f"{base}.up_convs.{level}"
            weight, bias = (self._values[f"{name}.upconv.{part}"] for part in ("weight", "bias"))
            x = functional.conv_transpose2d(x, weight, bias, stride=2)
            x = torch.cat([x, across[1 - level]], 1)
            for convolution in ("conv1", "conv2"):
                x = self._convolved(f"{name}.{convolution}", x, 1).relu()
        return self._convolved(f"{base}.conv_final", x, 0)

    def decoded(self, name: str, points: Tensor) -> Tensor:
        """Return the numbers (N, outputs) of a decoder at points (N, 3)."""
        features = []
        for axes, plane in self._planes.items():
            at = 2.0 * self.normalized(points[:, list(axes)]) - 1.0
            read = functional.grid_sample(
                plane, at[None, :, None], padding_mode="border", align_corners=True
            )
            features.append(read[0, :, :, 0].T)
        joined = torch.cat(features, 1)
        x = self._linear(f"{name}.fc_p", points)
        for block in range(5):
            x = x + self._linear(f"{name}.fc_c.{block}", joined)
            inner = self._linear(f"{name}.blocks.{block}.fc_0", x.relu())
            x = x + self._linear(f"{name}.blocks.{block}.fc_1", inner.relu())
        return self._linear(f"{name}.fc_out", x.relu())

    def _linear(self, name: str, x: Tensor) -> Tensor:
        return x @ self._values[f"{name}.weight"].T + self._values[f"{name}.bias"]


@pytest.mark.parametrize("name", ["new", "giga_packed.pt", "giga_pile.pt"])
def test_giga_is_its_layers(name: str, field: Tensor) -> None:
    network = given(GigaNetwork(), name)
    assert isinstance(network, GigaNetwork)
    points = torch.rand(300, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    with torch.inference_mode():
        layers = GigaByLayers(network.state_dict(), field)
        planes = network.encode(field)
        found = network.grasps(planes, points[None])
        rotation = layers.decoded("decoder_rot", points)
        for mine, expected in (
            (found.quality[0], layers.decoded("decoder_qual", points)[:, 0].sigmoid()),
            (found.quaternion_xyzw[0], rotation / rotation.norm(dim=-1, keepdim=True)),
            (found.width[0], layers.decoded("decoder_width", points)[:, 0]),
            (
                network.occupancy(planes, points[None])[0],
                layers.decoded("decoder_tsdf", points)[:, 0],
            ),
        ):
            torch.testing.assert_close(mine, expected, rtol=1e-3, atol=1e-4)
