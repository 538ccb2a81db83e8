"""GIGA: its network, and what it finds with the authors' weights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn import functional

from split_drake.baselines.giga.detector import SELECTION, GigaDetector
from split_drake.baselines.giga.network import GigaNetwork, read_planes
from split_drake.baselines.selection import SelectionConfig
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.pose_task import UPRIGHT, UnknownTaskError
from split_drake.scene import Scene
from split_drake.station.layout import Layout
from tests.split_drake.baselines.table_views import side_view, views

WEIGHTS = Path(__file__).parents[4] / "shared/peer_weights/giga_packed.pt"
EDGE = 40


def test_the_network_has_gigas_parameters() -> None:
    network = GigaNetwork()
    assert sum(each.numel() for each in network.parameters()) == pytest.approx(582e3, rel=0.02)
    tsdf, points = torch.zeros(2, EDGE, EDGE, EDGE), torch.rand(2, 7, 3) - 0.5
    found = network(tsdf, points)
    assert found.quality.shape == found.width.shape == (2, 7)
    assert torch.allclose(found.quaternion_xyzw.norm(dim=-1), torch.ones(2, 7))
    assert ((found.quality >= 0.0) & (found.quality <= 1.0)).all()
    assert network.occupancy(network.encode(tsdf), points).shape == (2, 7)
    with pytest.raises(ValueError, match=r"expected \(B, 40, 40, 40\)"):
        network(torch.zeros(1, 32, 32, 32), points)


def test_a_point_sees_the_place_that_it_is_at() -> None:
    network = GigaNetwork().double()
    network.encoder.unet = torch.nn.Identity()  # type: ignore[assignment]
    tsdf = torch.rand(1, EDGE, EDGE, EDGE, dtype=torch.float64)
    voxels = functional.relu(network.encoder.conv_in(tsdf[:, None]))[0]
    i, j, k = 5, 11, 29
    # Voxel i of the field stands at i / 39 of the cube's edge, and so does a pixel of a plane.
    point = torch.tensor([i, j, k], dtype=torch.float64) / (EDGE - 1) - 0.5
    found = read_planes(network.encode(tsdf), point[None, None])[0, 0]
    expected = torch.cat(
        [voxels.mean(2)[:, i, k], voxels.mean(3)[:, i, j], voxels.mean(1)[:, j, k]]
    )
    torch.testing.assert_close(found, expected, rtol=0.0, atol=2e-4)


def test_only_grasps_are_found_and_only_in_views() -> None:
    detector = GigaDetector(GigaNetwork(), SelectionConfig(threshold=0.99))
    rng = np.random.default_rng(0)
    scene = Scene.from_views(views((1, 0.5, 0.0)), Layout().workspace)
    with pytest.raises(UnknownTaskError, match="GIGA has no task 'upright'; it has grasp"):
        detector.detect(scene, [UPRIGHT], rng)
    blind = Scene(scene.p_WPs, scene.p_WSs, scene.workspace)
    with pytest.raises(ValueError, match="no depth views"):
        detector.detect(blind, ["grasp"], rng)
    assert len(detector.detect(scene, ["grasp"], rng)["grasp"]) == 0


@pytest.mark.skipif(not WEIGHTS.is_file(), reason=f"the authors' weights are not at {WEIGHTS}")
def test_the_authors_weights_find_grasps_on_the_objects() -> None:
    network = GigaNetwork()
    network.load_state_dict(torch.load(WEIGHTS, map_location="cpu", weights_only=True))
    places = ((1, 0.45, 0.0), (3, 0.55, 0.05))
    seen, workspace = views(*places, cameras=[side_view()]), Layout().workspace
    field = fused_tsdf(seen, workspace)
    found = GigaDetector(network, replace(SELECTION, threshold=0.5)).grasps(field, workspace)
    distances = [np.linalg.norm(found.X_WPs[:, :2, 3] - p, axis=1) for _, *p in places]
    assert (np.minimum(*distances) < 0.06).all()
    assert all((each < 0.06).any() for each in distances)
    assert (found.X_WPs[:, 2, 2] < 0.1).all(), "a hand comes from above or from the side"
    # Its occupancy knows how tall things are: 12 cm and 6 cm.
    inside = workspace.p_WV + workspace.edge_m / 2.0
    queries = np.array([[x, y, z] for _, x, y in places for z in (0.02, 0.045, 0.08, 0.15)])
    points = torch.tensor((queries - inside) / workspace.edge_m, dtype=torch.float32)
    with torch.inference_mode():
        solid = network.occupancy(network.encode(torch.tensor(field)[None]), points[None])[0] > 0.0
    assert solid.tolist() == [True, True, True, False, True, True, False, False]
