"""What a process for each core is worth in training: ``pytest tests/benchmarks/test_training.py``.

One process of two threads, and two of one thread each, train the default network in turns.  The
rates are those of the fastest turns; the range of the ratio tells how much other work disturbs.
On a machine that is not idle, threads that spin while they wait for one another lose most of their
time: ``OMP_WAIT_POLICY=PASSIVE`` decides about the single process.
"""

import time
from functools import partial

import numpy as np
import pytest
import torch

from split_drake.split.network import SplitConfig
from split_drake.training.batches import BatchConfig
from split_drake.training.memory import keep_freed_memory
from split_drake.training.precision import uses_bfloat16
from split_drake.training.trainer import OptimizerConfig, Trainer
from split_drake.training.workers.team import TakeStep, team
from tests.helpers.training import scenes_on_cpu

TURNS, STEPS = 5, 8
PROCESSES = 2


def make_trainer(batch: BatchConfig, bfloat16: bool) -> Trainer:
    return Trainer(scenes_on_cpu(), SplitConfig(), batch, OptimizerConfig(), 0, bfloat16)


def scene_steps_per_s(take_step: TakeStep, threads: int) -> float:
    """Return how many scenes a second a whole batch's steps are."""
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    began_s = time.perf_counter()
    for _ in range(STEPS):
        take_step(0.0)
    passed_s = time.perf_counter() - began_s
    torch.set_num_threads(before)
    return STEPS * BatchConfig().scenes / passed_s


def test_a_process_for_each_core(threads: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert threads == PROCESSES
    keep_freed_memory()
    bfloat16 = uses_bfloat16("auto")
    alone = make_trainer(BatchConfig(), bfloat16)
    make_share = partial(make_trainer, BatchConfig().share(PROCESSES), bfloat16)
    rates = list[tuple[float, float]]()
    with team(make_share, make_share(), PROCESSES) as take_step:
        scene_steps_per_s(alone.take_step, threads)  # the first steps fill memory
        scene_steps_per_s(take_step, 1)
        for _ in range(TURNS):
            one = scene_steps_per_s(alone.take_step, threads)
            rates.append((one, scene_steps_per_s(take_step, 1)))
    one, many = np.max(rates, axis=0)
    ratios = [many / one for one, many in rates]
    with capsys.disabled():
        print(
            f"\n1 process of {threads} threads: {one:.1f} scene-steps/s; {PROCESSES} of 1: "
            f"{many:.1f}, {many / one:.2f} times as many (turn by turn {min(ratios):.2f} to "
            f"{max(ratios):.2f}, median {np.median(ratios):.2f}), bfloat16 {bfloat16}"
        )
