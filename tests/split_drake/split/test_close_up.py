"""A second look at grasps: what close-ups show, and what becomes of scores."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from split_drake.bad_input import BadInputError
from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.data.render import DepthRenderer
from split_drake.pose_set import ALL_ACCEPTED
from split_drake.pose_task import GRASP, HANDLE
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import CheckpointInfo, load_checkpoint, save_checkpoint
from split_drake.split.close_up.choice import worth_a_look
from split_drake.split.close_up.config import CloseUpConfig
from split_drake.split.close_up.images import cell_middles, shown_by, smoothed
from split_drake.split.detector import SamplerConfig, SplitDetector
from split_drake.split.network import SplitNetwork
from split_drake.split.sampling import LangevinConfig
from split_drake.station.layout import CameraPlacement
from tests.helpers.checkpoints import new_network
from tests.helpers.training import NETWORK

WORKSPACE = Workspace()
CLOSE_UP = CloseUpConfig(channels=(4, 4, 8, 8), width=16)
# A box of 3 x 4 x 6 cm stands in the middle of the workspace.
BOX_M = np.array([0.03, 0.04, 0.06])
MIDDLE = np.add(WORKSPACE.p_WCenter, (0.0, 0.0, 0.03))
# From above, the pads beside the box, G in its middle.
X_WG = make_pose(rotation_x(np.pi), MIDDLE)
SAMPLER = SamplerConfig(samples=16, langevin=LangevinConfig(steps=4), acceptance=ALL_ACCEPTED)


def view_from(side: Array) -> DepthView:
    """Return what a camera sees of the box, 60 cm away in a direction."""
    mesh = trimesh.creation.box(BOX_M)
    X_WC = look_at(MIDDLE + 0.6 * side / np.linalg.norm(side), MIDDLE)
    camera = CameraPlacement("side", Intrinsics.centered(320, 240, 270.0), X_WC)
    return DepthRenderer(mesh).render(make_pose(p=MIDDLE), camera)


LEFT, RIGHT = view_from(np.array([0.0, 1.0, 1.0])), view_from(np.array([0.0, -1.0, 1.0]))


@pytest.fixture(scope="module")
def looking() -> SplitNetwork:
    torch.manual_seed(1)
    plain = new_network()
    network = SplitNetwork(replace(NETWORK, close_up=CLOSE_UP), plain.tasks).eval()
    network.take_over(plain)
    return network


def test_smoothing_takes_noise_and_leaves_rims() -> None:
    depth_m = torch.full((60, 60), 0.6)
    depth_m[:, 30:] = 0.55
    depth_m[10, 10] = 0.0
    noise = 0.005 * torch.randn(60, 60, generator=torch.Generator().manual_seed(0))
    calm = smoothed(torch.where(depth_m > 0.0, depth_m + noise, 0.0))
    error = (calm - depth_m)[depth_m > 0.0]
    assert error.std() < 0.0015
    assert error.abs().max() < 0.01, "a rim of 5 cm stays where it is"
    assert calm[10, 10] == 0.0


def test_cells_know_their_distance_before_what_is_seen() -> None:
    shown = shown_by([LEFT], WORKSPACE, X_WG[None], CLOSE_UP)[0]
    assert shown.shape == (4, *CLOSE_UP.cells)
    fine, coarse, hidden, height = shown.flatten(1)
    p_GQs = cell_middles(CLOSE_UP).numpy()
    p_WQs = p_GQs @ X_WG[:3, :3].T + X_WG[:3, 3]
    np.testing.assert_allclose(height, ((p_WQs[:, 2]) / 0.02).clip(-1.0, 1.0), atol=1e-5)
    assert not hidden.any()
    within = np.all(np.abs(p_WQs - MIDDLE) < BOX_M / 2.0 - 0.004, axis=1)
    assert within.sum() > 50
    assert (fine[within] < 0.0).all(), "inside of the box"
    above = (p_WQs[:, 2] > 0.068) & (np.abs(p_GQs[:, 1]) < 0.02)
    assert (coarse[above] > 0.0).all() and above.any(), "the air above it"
    behind = (p_WQs[:, 1] < -0.03) & (np.abs(p_WQs[:, 0] - 0.5) < 0.01) & (p_WQs[:, 2] < 0.02)
    assert (coarse[behind] < 0.0).all() and behind.any(), "what it hides"


def test_what_one_camera_sees_through_is_free() -> None:
    left, right, both = (
        shown_by(views, WORKSPACE, X_WG[None], CLOSE_UP)[0, 1]
        for views in ([LEFT], [RIGHT], [LEFT, RIGHT])
    )
    torch.testing.assert_close(both, torch.maximum(left, right))
    assert not torch.equal(both, left)
    blind = replace(LEFT, depth_m=np.zeros_like(LEFT.depth_m))
    shown = shown_by([blind], WORKSPACE, X_WG[None], CLOSE_UP)[0]
    assert (shown[2] == 1.0).all() and not shown[:2].any()


@pytest.mark.parametrize(
    ("p_WC", "p_WTarget", "seen"),
    [
        ((0.5, 0.1, 0.08), MIDDLE, True),  # inside of the workspace
        ((0.5, 3.0, 1.0), (0.5, 6.0, 0.0), False),  # behind the camera
        ((0.5, 0.6, 0.6), (-1.0, 0.0, 0.0), False),  # before it, beside the image
    ],
)
def test_a_camera_may_be_anywhere(p_WC: Array, p_WTarget: Array, seen: bool) -> None:
    intrinsics = Intrinsics.centered(60, 40, 30.0 if seen else 60.0)
    view = DepthView(np.full((40, 60), 0.05, np.float32), intrinsics, look_at(p_WC, p_WTarget))
    shown = shown_by([view], WORKSPACE, X_WG[None], CLOSE_UP)
    assert shown.isfinite().all()
    assert bool((shown[0, 2] == 1.0).all()) != seen
    both = shown_by([view, LEFT], WORKSPACE, X_WG[None], CLOSE_UP)
    assert not (both[0, 2] == 1.0).all()


def test_half_a_turn_of_the_hand_mirrors_the_close_up() -> None:
    turned = X_WG @ make_pose(rotation_z(np.pi))
    one, other = shown_by([LEFT], WORKSPACE, np.stack([X_WG, turned]), CLOSE_UP)
    torch.testing.assert_close(one, other.flip(1, 2), atol=0.02, rtol=0.0)


def seen() -> Scene:
    return Scene.from_views([LEFT], WORKSPACE)


def test_the_best_are_looked_at_again_and_the_others_rejected(looking: SplitNetwork) -> None:
    def sample(network: SplitNetwork, scene: Scene, looks: int = 5) -> dict[str, np.ndarray]:
        detector = SplitDetector(network, WORKSPACE, replace(SAMPLER, close_ups=looks))
        drawn = detector.sample(scene, (GRASP, HANDLE), np.random.default_rng(0))
        return {name: poses.scores for name, poses in drawn.items()}

    before, after = sample(new_network(), seen()), sample(looking, seen())
    best = np.flatnonzero(after["grasp"])
    assert len(best) == 5 and np.argmax(before["grasp"]) in best
    assert (after["grasp"][best] != before["grasp"][best]).all()
    np.testing.assert_array_equal(after["handle"], before["handle"])
    for scene, looks in ((replace(seen(), views=()), 5), (seen(), 0)):
        np.testing.assert_array_equal(sample(looking, scene, looks)["grasp"], before["grasp"])
    everything = sample(looking, seen(), looks=100)["grasp"]
    assert (everything > 0.0).all()
    np.testing.assert_allclose(everything[best], after["grasp"][best], rtol=1e-5)


def test_nearly_the_same_is_not_looked_at_twice() -> None:
    beside = [X_WG @ make_pose(p=(0.0, 0.002 * number, 0.0)) for number in range(4)]
    turned = X_WG @ make_pose(rotation_z(np.pi - 0.1))
    elsewhere = X_WG @ make_pose(p=(0.0, 0.0, -0.02))
    X_WGs = np.stack([*beside, turned, elsewhere])
    logits = np.array([0.1, 0.5, 0.2, 0.3, 0.4, 0.0])
    assert worth_a_look(X_WGs, logits, 2).tolist() == [1, 5]
    assert worth_a_look(X_WGs, logits, 3).tolist() == [1, 4, 5], "half a turn is the same grasp"
    assert worth_a_look(X_WGs, logits, 9).tolist() == [1, 4, 3, 2, 0, 5]


def test_a_checkpoint_keeps_the_second_look(looking: SplitNetwork, tmp_path: Path) -> None:
    path = tmp_path / "looking.safetensors"
    info = CheckpointInfo(looking.config, looking.tasks, WORKSPACE, {}, 0, "data", "abc", 1, 1)
    save_checkpoint(path, looking, info)
    again, found = load_checkpoint(path)
    assert found.config.close_up == CLOSE_UP
    assert again.close_up is not None and looking.close_up is not None
    shown = torch.rand(3, 4, *CLOSE_UP.cells)
    torch.testing.assert_close(again.close_up(shown), looking.close_up(shown))


def test_weights_go_over_with_and_without_a_second_look(looking: SplitNetwork) -> None:
    plain = new_network()
    plain.take_over(looking)
    assert plain.close_up is None
    other = SplitNetwork(looking.config, looking.tasks).eval()
    other.take_over(looking)
    assert all(
        torch.equal(value, looking.state_dict()[name]) for name, value in other.state_dict().items()
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"cells": (10, 40)}, r"cells is \(10, 40\); expected 3 numbers"),
        ({"cells": (10, 0, 18)}, "cells is 0; expected"),
        ({"spacing_m": (0.0, 0.003, 0.004)}, "a distance of a close-up is 0.0; expected"),
        ({"width": 0}, "width is 0; expected"),
    ],
)
def test_impossible_close_ups_are_errors(change: dict[str, object], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        replace(CLOSE_UP, **change)  # type: ignore[arg-type]
    with pytest.raises(BadInputError, match="close_ups is -1; expected"):
        SamplerConfig(close_ups=-1)
