"""SPLIT's network: feature lookup, local context and its symmetry, conditioning, configuration."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional

from split_drake.pose_task import GRASP, MUG_TASKS, UPRIGHT, PoseTask, Symmetry
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.context import FeatureTables, in_pose_axes, point_kernel
from split_drake.split.network import SplitNetwork
from split_drake.split.network_config import ContextKind, ScoreFrame, SplitConfig
from split_drake.split.se3 import compose, so3_exp, uniform_rotations

EDGE_M = 0.3


def small_network(
    context_grids: tuple[int, ...] = (0, 1, 3),
    context: ContextKind = "local",
    score_frame: ScoreFrame = "sample",
    tasks: tuple[PoseTask, ...] = MUG_TASKS,
) -> SplitNetwork:
    """Return a small untrained network in inference mode."""
    torch.manual_seed(0)
    config = SplitConfig(
        channels=(4, 8, 8),
        context_grids=context_grids,
        width=32,
        layers=4,
        context=context,
        score_frame=score_frame,
    )
    return SplitNetwork(config, tasks).eval()


def random_grid(size: int, scenes: int = 2) -> Tensor:
    """Return features (scenes, 3, size, size, size)."""
    return torch.rand(scenes, 3, size, size, size, generator=torch.Generator().manual_seed(size))


def random_points(count: int, scenes: int = 2) -> Tensor:
    """Return points (scenes, count, 3) in V, some of them outside the grid."""
    generator = torch.Generator().manual_seed(9)
    return EDGE_M * (1.2 * torch.rand(scenes, count, 3, generator=generator) - 0.1)


def grid_sample(grid: Tensor, p_VQs: Tensor) -> Tensor:
    """Return what PyTorch interpolates; it takes coordinates in [-1, 1], the last axis first."""
    unit = (2.0 * p_VQs / EDGE_M - 1.0).flip(-1)[:, :, None, None]
    sampled = functional.grid_sample(grid, unit, align_corners=False, padding_mode="border")
    return sampled[..., 0, 0].transpose(1, 2)


@pytest.mark.parametrize("size", [64, 16, 2])
def test_lookup_is_trilinear_interpolation(size: int) -> None:
    grid, p_VQs = random_grid(size), random_points(500)
    tables = FeatureTables.from_grids([grid], EDGE_M)
    assert torch.allclose(tables.lookup(p_VQs), grid_sample(grid, p_VQs), atol=2e-5)


def test_lookup_at_a_voxels_centre_is_that_voxel() -> None:
    grid = random_grid(64, scenes=1)
    p_VQ = (torch.tensor([[[5.0, 20.0, 63.0]]]) + 0.5) * EDGE_M / 64
    tables = FeatureTables.from_grids([grid], EDGE_M)
    assert torch.allclose(tables.lookup(p_VQ)[0, 0], grid[0, :, 5, 20, 63], atol=1e-5)


def test_lookup_passes_gradients_to_the_grid() -> None:
    grid = random_grid(4).requires_grad_()
    FeatureTables.from_grids([grid], EDGE_M).lookup(random_points(10)).sum().backward()
    assert grid.grad is not None
    assert grid.grad.sum().item() == pytest.approx(2 * 10 * 3, rel=1e-5)


def test_kernel_points_follow_the_pose() -> None:
    voxel = torch.arange(64.0)
    coordinates = torch.stack(torch.meshgrid(voxel, voxel, voxel, indexing="ij"))[None]
    tables = FeatureTables.from_grids([coordinates], EDGE_M)
    R = so3_exp(torch.tensor([0.3, -0.5, 1.0]))
    X_VP = compose(R, torch.tensor([0.16, 0.14, 0.15]))
    context = tables.around(X_VP[None, None], point_kernel(0.08)).view(7, 3)
    p_VKs = (context + 0.5) * EDGE_M / 64
    p_PKs = (p_VKs - X_VP[:3, 3]) @ R
    expected = 0.08 * torch.tensor(
        [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    )
    assert torch.allclose(p_PKs, expected, atol=1e-5)


def test_context_moves_along_with_the_scene() -> None:
    """A shift by whole cells changes no context (grids whose cells don't see the border)."""
    network = small_network(context_grids=(0, 1, 2))
    scene = torch.zeros(2, 64, 64, 64, dtype=torch.bool)
    rng = np.random.default_rng(0)
    blob = torch.tensor(rng.random((12, 12, 12)) < 0.2)
    scene[0, 20:32, 24:36, 24:36] = blob
    scene[1, 28:40, 24:36, 24:36] = blob
    shift = torch.tensor([[0.0, 0.0, 0.0], [8 * EDGE_M / 64, 0.0, 0.0]])
    R = uniform_rotations((5,), torch.Generator().manual_seed(0))
    p = torch.tensor([0.13, 0.14, 0.14]) + shift[:, None]
    X_VPs = compose(R.expand(2, 5, 3, 3), p.expand(2, 5, 3))
    with torch.inference_mode():
        context = network.local_context(network.encode(scene), X_VPs)
    assert torch.allclose(context[0], context[1], atol=1e-4)
    assert context[0].std(0).max() > 0.01


def test_encoder_is_told_where_the_table_is() -> None:
    network = small_network()
    grid = network.encode(torch.zeros(1, 64, 64, 64, dtype=torch.bool)).tables[0]
    below = grid.view(64, 64, 64, 2)[0, 0, :, 1]
    heights_m = (torch.arange(64) + 0.5) * EDGE_M / 64
    assert torch.equal(below > 0.5, heights_m < 0.05)


def test_heads_answer_by_task_and_noise_level() -> None:
    network = small_network()
    torch.nn.init.normal_(network.score_head.output.weight)
    torch.nn.init.normal_(network.score_head.film.weight)
    torch.nn.init.normal_(network.evaluator_head.film.weight)
    context = torch.rand(1, 5, network.config.context_width).expand(3, 5, -1)
    with torch.inference_mode():
        by_task = network.score(context, torch.arange(3), torch.full((3,), 0.3))
        by_sigma = network.score(context, torch.zeros(3).long(), torch.tensor([0.03, 0.3, 1.5]))
        logits = network.evaluate(context, torch.arange(3))
    assert by_task.shape == (3, 5, 6)
    assert logits.shape == (3, 5)
    for values in (by_task, by_sigma, logits):
        assert (values[0] - values[1]).abs().min() > 0.0
        assert (values[1] - values[2]).abs().min() > 0.0
    assert torch.allclose(by_task[0], by_sigma[1], atol=1e-6)


def test_heads_are_for_as_many_tasks_as_there_are() -> None:
    network = small_network(tasks=(GRASP, PoseTask("lid", Symmetry.any_turn("z"))))
    torch.nn.init.normal_(network.evaluator_head.film.weight)
    context = torch.rand(1, 5, network.config.context_width).expand(2, 5, -1)
    with torch.inference_mode():
        logits = network.evaluate(context, torch.arange(2))
    assert logits.shape == (2, 5)
    assert (logits[0] - logits[1]).abs().min() > 0.0
    with pytest.raises(RuntimeError, match="num_classes"), torch.inference_mode():
        network.evaluate(context, torch.tensor([0, 2]))


def random_scenes() -> Tensor:
    """Return two scenes (2, 64, 64, 64), a blob each."""
    scenes = torch.zeros(2, 64, 64, 64, dtype=torch.bool)
    scenes[0, 20:32, 24:36, 24:36] = True
    scenes[1, 30:36, 10:30, 24:50] = True
    return scenes


def random_poses() -> Tensor:
    """Return poses (2, 5, 4, 4) in V."""
    R = uniform_rotations((2, 5), torch.Generator().manual_seed(0))
    return compose(R, 0.1 + 0.1 * torch.rand(2, 5, 3, generator=torch.Generator().manual_seed(1)))


def test_a_global_context_is_the_scene_and_the_pose_but_not_what_is_around_it() -> None:
    network = small_network(context="global")
    X_VPs = random_poses()
    with torch.inference_mode():
        context = network.local_context(network.encode(random_scenes()), X_VPs)
    assert context.shape[-1] == network.config.context_width
    latent, p_scaled, R = context.split([network.config.latent_width, 3, 9], -1)
    assert torch.equal(latent, latent[:, :1].expand_as(latent)), "the same for all poses of a scene"
    assert (latent[0] - latent[1]).abs().max() > 1e-4, "another scene has another latent"
    assert torch.allclose(0.5 * (p_scaled + 1.0) * EDGE_M, X_VPs[..., :3, 3], atol=1e-6)
    assert torch.equal(R.unflatten(-1, (3, 3)), X_VPs[..., :3, :3])


def test_a_global_latent_tells_places_in_the_scene_apart() -> None:
    """Pooled over the scene, it could not say where the object is."""
    network = small_network(context="global")
    scenes = torch.zeros(2, 64, 64, 64, dtype=torch.bool)
    scenes[0, 8:16, 28:36, 28:36] = True
    scenes[1, 40:48, 28:36, 28:36] = True  # four coarsest cells further
    with torch.inference_mode():
        latents = network.encode(scenes).tables[0]
    assert (latents[0] - latents[1]).abs().max() > 1e-4


@pytest.mark.parametrize("context", ["local", "global"])
def test_scores_in_global_axes_come_back_in_those_of_the_pose(context: ContextKind) -> None:
    network = small_network(context=context, score_frame="global")
    X_VPs = random_poses()
    motion_V = torch.tensor([0.3, -0.2, 0.1, 1.0, -2.0, 0.5])
    torch.nn.init.zeros_(network.score_head.output.weight)
    with torch.no_grad():
        network.score_head.output.bias.copy_(motion_V)
    with torch.inference_mode():
        poses = network.local_context(network.encode(random_scenes()), X_VPs)
        score = network.score(poses, torch.arange(2), torch.full((2,), 0.3))
    R_VPs = X_VPs[..., :3, :3]
    for part in (slice(0, 3), slice(3, 6)):
        p_Vs = (R_VPs @ score[..., part, None])[..., 0]
        assert torch.allclose(p_Vs, motion_V[part].expand_as(p_Vs), atol=1e-6)


def test_axes_change_in_full_precision_under_autocast() -> None:
    R = random_poses()[0, :, :3, :3]
    motions = torch.tensor([[0.1234567, 0.7654321, -0.5, 1.1, -0.123, 0.987]]).expand(5, 6)
    with torch.autocast("cpu", torch.bfloat16):
        turned = in_pose_axes(motions, R)
    expected = torch.cat([(v[:, None] @ R)[:, 0] for v in motions.split(3, -1)], -1)
    assert torch.allclose(turned, expected, atol=1e-6)


def test_weights_from_before_there_were_variants_are_split() -> None:
    network, info = load_checkpoint(default_weights())
    assert (info.config.context, info.config.score_frame) == ("local", "sample")
    assert network.config.pose_width == 0


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: SplitConfig(resolution=32), "resolution"),
        (lambda: SplitConfig(context_grids=(0, 6)), "context_grids"),
        (lambda: SplitConfig(layers=2), "layers"),
        (lambda: SplitConfig(context=cast(ContextKind, "nearby")), "context"),
        (lambda: SplitConfig(score_frame=cast(ScoreFrame, "robot")), "score_frame"),
    ],
)
def test_impossible_architectures_are_errors(make: Callable[[], SplitConfig], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        make()


def test_weights_of_more_tasks_are_taken_over() -> None:
    every, some = small_network(), small_network(tasks=(UPRIGHT, GRASP))
    some.take_over(every)
    context = torch.randn(2, 3, every.config.context_width)
    sigma = torch.tensor([0.1, 0.5])
    of_some, of_every = torch.tensor([0, 1]), torch.tensor([2, 0])
    assert torch.allclose(
        some.score(context, of_some, sigma), every.score(context, of_every, sigma), atol=1e-6
    )
    assert torch.allclose(
        some.evaluate(context, of_some), every.evaluate(context, of_every), atol=1e-6
    )
    with pytest.raises(ValueError, match="does not know handle"):
        every.take_over(some)


@pytest.mark.parametrize("score_frame", ["sample", "global"])
def test_inner_points_start_without_a_say(score_frame: ScoreFrame) -> None:
    outer = small_network(score_frame=score_frame)
    for head in (outer.score_head, outer.evaluator_head):
        torch.nn.init.normal_(head.output.weight)
    config = replace(outer.config, inner_offsets_m=(0.02, 0.04), inner_grids=(0, 1))
    inner = SplitNetwork(config, outer.tasks).eval()
    inner.take_over(outer)
    X_VPs, tasks, sigma = random_poses(), torch.zeros(2).long(), torch.full((2,), 0.3)
    with torch.inference_mode():
        tables = inner.encode(random_scenes())
        contexts = [each.local_context(tables, X_VPs) for each in (outer, inner)]
        assert contexts[1].shape[-1] - contexts[0].shape[-1] == 2 * 6 * (2 + 4)
        scores = [
            each.score(context, tasks, sigma)
            for each, context in zip((outer, inner), contexts, strict=True)
        ]
        logits = [
            each.evaluate(context, tasks)
            for each, context in zip((outer, inner), contexts, strict=True)
        ]
    torch.testing.assert_close(*scores)
    torch.testing.assert_close(*logits)
    with pytest.raises(ValueError, match="of another architecture"):
        outer.take_over(inner)


def test_inner_points_are_of_the_local_context() -> None:
    config = small_network().config
    with pytest.raises(ValueError, match=r"inner_grids=\(2,\); expected some of the context's"):
        replace(config, inner_offsets_m=(0.04,), inner_grids=(2,))
    with pytest.raises(ValueError, match="expected none with the global context"):
        replace(config, context="global", inner_offsets_m=(0.04,), inner_grids=(0,))
