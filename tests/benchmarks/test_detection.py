"""How long a detection takes, and its parts: ``pytest tests/benchmarks``."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import GRASP, MUG_TASKS
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.detector import CLUTTER_SAMPLER, SamplerConfig, SplitDetector
from split_drake.split.inference.network import InferenceEncoder, InferenceNetwork
from split_drake.split.inference.scene import ScenePredictor
from split_drake.split.network import SplitNetwork
from split_drake.split.se3 import compose, uniform_rotations

Measure = Callable[[Callable[[], Any]], None]
SAMPLES = SamplerConfig().samples


@pytest.fixture(scope="module")
def network() -> SplitNetwork:
    return load_checkpoint(default_weights())[0]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return a mug that stands in the middle, with the noise of the paper (section V)."""
    workspace = Workspace()
    mesh = load_mug("test_001").body.mesh
    p_OPs, _ = trimesh.sample.sample_surface(mesh, Scene.SAMPLED_POINTS, seed=0)
    p_WPs = np.asarray(p_OPs) + workspace.p_WCenter
    return Scene(p_WPs, p_WPs, workspace).with_noise(0.005, np.random.default_rng(0))


@pytest.fixture(scope="module")
def occupied(scene: Scene) -> torch.Tensor:
    return torch.tensor(scene.grid())


@pytest.fixture(scope="module")
def poses() -> torch.Tensor:
    """Return as many poses a task (T, N, 4, 4) as are sampled, anywhere in the cube."""
    generator = torch.Generator().manual_seed(0)
    shape = (len(MUG_TASKS), SAMPLES)
    p_VPs = Workspace().edge_m * torch.rand((*shape, 3), generator=generator)
    return compose(uniform_rotations(shape, generator), p_VPs)


def test_encoder(measure: Measure, network: SplitNetwork, occupied: torch.Tensor) -> None:
    encoder = InferenceEncoder(network.encoder, network.config.resolution)
    with torch.inference_mode():
        measure(lambda: network.encode(occupied[None], encoder))


def test_one_score_evaluation(
    measure: Measure, network: SplitNetwork, occupied: torch.Tensor, poses: torch.Tensor
) -> None:
    with torch.inference_mode():
        predictor = ScenePredictor(InferenceNetwork(network), occupied, MUG_TASKS)
    measure(lambda: predictor.score(poses, 0.3))


def test_detection_of_grasps_in_clutter(measure: Measure, scene: Scene) -> None:
    clutter = load_checkpoint(default_weights().with_name("split_clutter.safetensors"))[0]
    detector = SplitDetector(clutter, scene.workspace, CLUTTER_SAMPLER)
    measure(lambda: detector.detect(scene, (GRASP,), np.random.default_rng(0)))


def test_detection_of_three_pose_sets(
    measure: Measure, network: SplitNetwork, scene: Scene
) -> None:
    detector = SplitDetector(network, scene.workspace)
    measure(lambda: detector.detect(scene, MUG_TASKS, np.random.default_rng(0)))
