"""The fast way to scores and logits against the network itself."""

import copy
import pickle
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from split_drake.pose_task import MUG_TASKS, UPRIGHT, PoseTask, Symmetry
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.inference.network import InferenceNetwork
from split_drake.split.inference.scene import ScenePredictor
from split_drake.split.network import SplitNetwork
from split_drake.split.network_config import SplitConfig
from split_drake.split.se3 import compose, uniform_rotations

SMALL = SplitConfig(channels=(4, 8, 80), width=32, layers=4, context_grids=(0, 1, 3))
# Some grids looked up and one folded, all folded, none folded, and the variants of the network.
CONFIGS = {
    "mixed": replace(SMALL, channels=(4, 8, 80, 96), context_grids=(0, 1, 3, 4)),
    "folded": replace(SMALL, channels=(4, 8, 80, 96, 128), context_grids=(4, 5)),
    "looked up": replace(SMALL, context_grids=(0, 1)),
    "global context": replace(SMALL, context="global"),
    "global frame": replace(SMALL, score_frame="global"),
    "inner points": replace(
        SMALL, context_grids=(0, 1, 3), inner_offsets_m=(0.02, 0.045), inner_grids=(3, 0)
    ),
    "inner points, global frame": replace(
        SMALL, score_frame="global", inner_offsets_m=(0.04,), inner_grids=(0,)
    ),
}


def randomized(config: SplitConfig, tasks: tuple[PoseTask, ...] = MUG_TASKS) -> SplitNetwork:
    """Return a network in inference mode, all of whose numbers matter, with outputs of about 1."""
    torch.manual_seed(0)
    network = SplitNetwork(config, tasks)
    for head in (network.score_head, network.evaluator_head):
        torch.nn.init.normal_(head.output.weight, std=0.1)
        torch.nn.init.normal_(head.film.bias, std=0.1)
        for norm in head.norms:
            torch.nn.init.normal_(norm.get_parameter("weight"), mean=1.0, std=0.1)
            torch.nn.init.normal_(norm.get_parameter("bias"), std=0.1)
    return network.eval()


def occupied_grid() -> Tensor:
    """Return a (64, 64, 64) grid with a shell of occupied voxels."""
    axis = torch.arange(64) - 32.0
    squares = axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2
    return (squares > 12.0**2) & (squares < 14.0**2)


def poses(tasks: int, samples: int) -> Tensor:
    """Return random poses (tasks, samples, 4, 4), in the cube, on its faces and on its corners."""
    generator = torch.Generator().manual_seed(0)
    share = 1.2 * torch.rand((tasks, samples, 3), generator=generator) - 0.1
    return compose(uniform_rotations((tasks, samples), generator), 0.3 * share.clamp(0.0, 1.0))


def assert_like_the_network(
    network: SplitNetwork, tasks: tuple[PoseTask, ...], samples: int = 48
) -> None:
    """Compare scores and logits at so many poses a task."""
    X_VPs, occupied = poses(len(tasks), samples), occupied_grid()
    indices = torch.tensor([network.tasks.index(task) for task in tasks])
    with torch.inference_mode():
        tables = network.encode(occupied[None])
        context = network.local_context(tables, X_VPs.flatten(0, 1)[None])
        context = context.view(len(tasks), samples, -1)
        predictor = ScenePredictor(InferenceNetwork(network), occupied, tasks)
        for sigma in (0.03, 0.4, 1.5):
            expected = network.score(context, indices, torch.full((len(tasks),), sigma))
            torch.testing.assert_close(
                predictor.score(X_VPs, sigma), expected, rtol=1e-4, atol=1e-5
            )
        expected = network.evaluate(context, indices)
        torch.testing.assert_close(predictor.evaluate(X_VPs), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", CONFIGS)
def test_predictions_are_those_of_the_network(name: str) -> None:
    assert_like_the_network(randomized(CONFIGS[name]), MUG_TASKS)


@pytest.mark.parametrize("tasks", [MUG_TASKS[1:], MUG_TASKS[::-1], (UPRIGHT,)])
def test_predictions_are_those_of_the_tasks_asked_for(tasks: tuple[PoseTask, ...]) -> None:
    assert_like_the_network(randomized(CONFIGS["mixed"]), tasks)


def test_predictions_may_be_of_any_tasks() -> None:
    lid = PoseTask("lid", Symmetry.any_turn("z"))
    network = randomized(CONFIGS["mixed"], (UPRIGHT, lid))
    assert_like_the_network(network, (lid, UPRIGHT))


@pytest.mark.parametrize("samples", [1, 7, 16, 50])
def test_predictions_do_not_depend_on_how_many_there_are(samples: int) -> None:
    assert_like_the_network(randomized(CONFIGS["mixed"]), MUG_TASKS[:2], samples)


def test_predictions_of_the_shipped_weights_are_those_of_the_network() -> None:
    assert_like_the_network(load_checkpoint(default_weights())[0], MUG_TASKS)


@pytest.fixture
def without_onednn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have layers made ready as where PyTorch comes without oneDNN."""
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: False)


@pytest.mark.usefixtures("without_onednn")
def test_predictions_without_onednn_are_those_of_the_network() -> None:
    assert_like_the_network(randomized(CONFIGS["inner points"]), MUG_TASKS)


def test_predictions_ask_for_no_gradient() -> None:
    network = InferenceNetwork(randomized(SMALL))
    predictor = ScenePredictor(network, occupied_grid(), MUG_TASKS)
    X_VPs = poses(len(MUG_TASKS), 5).requires_grad_()
    found = (predictor.score(X_VPs, 0.3), predictor.evaluate(X_VPs))
    kept = network.score_layers(0, 0.3)
    assert not any(each.requires_grad for each in (*found, kept.scale, kept.shift))


def test_layers_are_kept_for_some_noise_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("split_drake.split.inference.network._KEPT", 2)
    network = InferenceNetwork(randomized(SMALL))
    first = [network.score_layers(1, sigma) for sigma in (1.0, 0.5, 0.2)]
    again = [network.score_layers(1, sigma) for sigma in (1.0, 0.5, 0.2)]
    assert [one is other for one, other in zip(first, again, strict=True)] == [True, True, False]


def test_copies_are_made_ready_anew() -> None:
    network = InferenceNetwork(randomized(SMALL))
    network.score_layers(0, 0.3)
    X_VPs = poses(len(MUG_TASKS), 5)
    expected = ScenePredictor(network, occupied_grid(), MUG_TASKS).score(X_VPs, 0.3)
    for copied in (copy.deepcopy(network), pickle.loads(pickle.dumps(network))):
        found = ScenePredictor(copied, occupied_grid(), MUG_TASKS).score(X_VPs, 0.3)
        torch.testing.assert_close(found, expected)


def test_a_network_in_training_is_refused() -> None:
    with pytest.raises(ValueError, match="in training mode; expected evaluation mode"):
        InferenceNetwork(randomized(SMALL).train())


def test_what_is_made_ready_leaves_the_network_as_it_was() -> None:
    network = randomized(SMALL)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    InferenceNetwork(network)
    assert all(each.requires_grad for each in network.parameters())
    for name, value in network.state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0.0, atol=0.0)
