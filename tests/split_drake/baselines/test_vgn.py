"""VGN: its network, which voxels are grasps, and what it finds with the authors' weights."""

from pathlib import Path

import numpy as np
import pytest
import torch

from split_drake.baselines.palm_frame import grippers_of_palms
from split_drake.baselines.selection import SelectionConfig, masked_quality, peaks
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.baselines.vgn.detector import VgnDetector
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.pose_task import UPRIGHT, UnknownTaskError
from split_drake.poses import make_pose, rotation_x
from split_drake.robot.gripper import PAD_SIZE_M
from split_drake.scene import Scene
from split_drake.station.layout import Layout
from tests.split_drake.baselines.table_views import views

# The parameters that VGN's and GIGA's authors published; a user fetches them.
WEIGHTS = Path(__file__).parents[4] / "shared/peer_weights/vgn_packed.pt"
EDGE = 40


def test_the_network_has_vgns_parameters() -> None:
    network = VgnNetwork()
    assert sum(each.numel() for each in network.parameters()) == pytest.approx(313e3, rel=0.01)
    found = network(torch.zeros(2, EDGE, EDGE, EDGE))
    assert found.quality.shape == found.width_voxels.shape == (2, EDGE, EDGE, EDGE)
    assert found.quaternion_xyzw.shape == (2, EDGE, EDGE, EDGE, 4)
    assert torch.allclose(found.quaternion_xyzw.norm(dim=-1), torch.tensor(1.0))
    assert ((found.quality >= 0.0) & (found.quality <= 1.0)).all()
    with pytest.raises(ValueError, match=r"expected \(B, 40, 40, 40\)"):
        network(torch.zeros(1, 32, 32, 32))


def field_of_a_table() -> np.ndarray:
    """Return a field that is free from voxel 10 on, within a surface below, unseen below 6."""
    field = np.zeros((EDGE, EDGE, EDGE), np.float32)
    field[..., 10:] = 0.9
    field[..., 6:10] = 0.3
    return field


def test_grasps_lie_at_free_space_and_fit_the_hand() -> None:
    field = field_of_a_table()
    high, fitting = np.ones_like(field), np.full_like(field, 5.0)
    masked = masked_quality(field, high, fitting, 0.5)
    assert (masked[..., 10:] > 0.99).all()
    assert (masked[..., :10] == 0.0).all(), "what lies within is not dilated into"
    for width in (1.0, 9.5):
        assert (masked_quality(field, high, np.full_like(field, width), 0.5) == 0.0).all()
    hollow = field.copy()
    hollow[20, 20, 6:10] = 0.0
    assert (masked_quality(hollow, high, fitting, 0.5)[20, 20, 8:10] > 0.99).all()
    assert (masked_quality(hollow, high, fitting, 0.5)[20, 20, 6:8] == 0.0).all()


def test_one_grasp_is_left_of_those_close_together() -> None:
    quality = np.zeros((EDGE, EDGE, EDGE), np.float32)
    quality[10, 10, 10], quality[11, 10, 10], quality[20, 10, 10] = 0.95, 0.92, 0.91
    quality[30, 10, 10] = 0.89
    assert peaks(quality, 0.9).tolist() == [[10, 10, 10], [20, 10, 10]]
    assert len(peaks(quality, 0.96)) == 0


def test_the_tips_of_the_fingers_are_five_centimetres_before_the_palm() -> None:
    X_WG = grippers_of_palms(make_pose(rotation_x(np.pi), (0.5, 0.0, 0.2)))
    tips = X_WG @ (0.0, 0.0, PAD_SIZE_M[1] / 2.0, 1.0)
    np.testing.assert_allclose(tips[:3], (0.5, 0.0, 0.15), atol=1e-12)


def test_only_grasps_are_found_and_only_in_views() -> None:
    detector = VgnDetector(VgnNetwork())
    rng = np.random.default_rng(0)
    scene = Scene.from_views(views((1, 0.5, 0.0)), Layout().workspace)
    with pytest.raises(UnknownTaskError, match="VGN has no task 'upright'; it has grasp"):
        detector.detect(scene, [UPRIGHT], rng)
    blind = Scene(scene.p_WPs, scene.p_WSs, scene.workspace)
    with pytest.raises(ValueError, match="no depth views"):
        detector.detect(blind, ["grasp"], rng)
    assert (
        len(
            VgnDetector(VgnNetwork(), SelectionConfig(threshold=0.99)).detect(
                scene, ["grasp"], rng
            )["grasp"]
        )
        == 0
    )


@pytest.mark.skipif(not WEIGHTS.is_file(), reason=f"the authors' weights are not at {WEIGHTS}")
def test_the_authors_weights_find_grasps_on_the_objects() -> None:
    network = VgnNetwork()
    network.load_state_dict(torch.load(WEIGHTS, map_location="cpu", weights_only=True))
    places = ((1, 0.45, 0.0), (3, 0.55, 0.05))
    seen, workspace = views(*places), Layout().workspace
    found = VgnDetector(network).grasps(fused_tsdf(seen, workspace), workspace)
    assert len(found) >= 2
    distances = [np.linalg.norm(found.X_WPs[:, :2, 3] - p, axis=1) for _, *p in places]
    assert (np.minimum(*distances) < 0.05).all()
    assert all((each < 0.05).any() for each in distances)
    # A hand comes from above or from the side, and never from below.
    assert (found.X_WPs[:, 2, 2] < 0.1).all()


def test_a_voxel_alone_says_what_it_says_among_all() -> None:
    network, generator = VgnNetwork(), torch.Generator().manual_seed(0)
    fields = torch.rand(2, 40, 40, 40, generator=generator)
    voxels = torch.randint(40, (2, 9, 3), generator=generator)
    voxels[0, :2] = torch.tensor([[0, 0, 0], [39, 39, 39]])
    scene = torch.arange(2)[:, None]
    with torch.inference_mode():
        for whole, alone in zip(network(fields), network.at(fields, voxels), strict=True):
            expected = whole[scene, voxels[..., 0], voxels[..., 1], voxels[..., 2]]
            torch.testing.assert_close(alone, expected, rtol=1e-4, atol=1e-5)
