"""Methods that find grasps beside VGN, in turns: `pytest tests/benchmarks`."""

from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter

import numpy as np
import pytest
import torch

from split_drake.baselines.giga.detector import GigaDetector
from split_drake.baselines.giga.network import GigaNetwork
from split_drake.baselines.se3dif.detector import Se3DifDetector
from split_drake.baselines.se3dif.network import Se3DifNetwork
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.baselines.vgn.detector import VgnDetector
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.pose_set import PoseDetector
from split_drake.pose_task import GRASP
from split_drake.scene import Scene
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.detector import CLUTTER_SAMPLER, SplitDetector
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout, two_views
from tests.benchmarks.processor import processor
from tests.split_drake.station.solids import solids, stand

ROUNDS, FEW_ROUNDS = 30, 5


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Return five solids on a table."""
    station = HandStation(solids(), Layout())
    for index in range(5):
        stand(station, index, 0.5 + 0.04 * (index - 2), 0.07 * (-1) ** index)
    return Scene.from_views(station.capture(two_views(Layout().workspace)), Layout().workspace)


def in_turns(*calls: Callable[[], object], rounds: int = ROUNDS) -> list[float]:
    """Return the median seconds of calls that are timed in turns, so that all meet one load.

    The first two rounds don't count: they warm up.
    """
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        for call, taken in zip(calls, times, strict=True):
            began = perf_counter()
            call()
            taken.append(perf_counter() - began)
    return [median(taken[2:]) for taken in times]


@pytest.mark.parametrize("threads", [1, 2])
def test_split_beside_vgn(scene: Scene, threads: int, capsys: pytest.CaptureFixture[str]) -> None:
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    weights = default_weights().with_name("split_clutter.safetensors")
    split = SplitDetector(load_checkpoint(weights)[0], scene.workspace, CLUTTER_SAMPLER)
    # How long it takes does not depend on the weights.
    vgn, field = VgnDetector(VgnNetwork()), fused_tsdf(scene.views, scene.workspace)
    split_s, vgn_s = in_turns(
        lambda: split.detect(scene, (GRASP,), np.random.default_rng(0)),
        lambda: vgn.grasps(field, scene.workspace),
    )
    with capsys.disabled():
        print(
            f"\n{threads} threads: 256 grasps by SPLIT take {1e3 * split_s:.0f} ms, VGN's planner "
            f"{1e3 * vgn_s:.0f} ms: {split_s / vgn_s:.2f} of its time"
        )
    assert split_s > 0.0 and vgn_s > 0.0


@pytest.mark.parametrize("threads", [1, 2])
def test_all_methods_on_one_scene(
    scene: Scene, threads: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """From one scene to its grasps: fields and codes are made within the time."""
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    weights = default_weights().with_name("split_clutter.safetensors")
    detectors: dict[str, PoseDetector] = {
        "VGN": VgnDetector(VgnNetwork()),
        "GIGA": GigaDetector(GigaNetwork()),
        "SPLIT": SplitDetector(load_checkpoint(weights)[0], scene.workspace, CLUTTER_SAMPLER),
        "SE(3)-Dif, whole scene": Se3DifDetector(Se3DifNetwork(), segments=False),
        "SE(3)-Dif, each segment": Se3DifDetector(Se3DifNetwork(), segments=True),
    }
    seconds = in_turns(
        *(partial(_detect, detector, scene) for detector in detectors.values()), rounds=FEW_ROUNDS
    )
    with capsys.disabled():
        print(f"\n{threads} threads on {processor()}:")
        for name, taken in zip(detectors, seconds, strict=True):
            print(f"  {name}: {1e3 * taken:.0f} ms, {taken / seconds[0]:.2f} times VGN's")
    assert min(seconds) > 0.0


def _detect(detector: PoseDetector, scene: Scene) -> None:
    detector.detect(scene, (GRASP,), np.random.default_rng(0))
