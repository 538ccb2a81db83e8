"""Detectors that the ablation puts together from trained models."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from split_drake.evaluation.examiner import SamplingDetector
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene
from split_drake.split.detector import SamplerConfig, ScoredSamples, SplitDetector
from split_drake.split.network import TASKS


class ChanceRanking:
    """A detector without its evaluator: chance ranks the samples, and none is rejected.

    Attributes:
        config: how samples are drawn.
    """

    config: SamplerConfig

    def __init__(self, detector: SamplingDetector) -> None:
        self._detector = detector
        self.config = replace(detector.config, threshold=0.0)

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, ScoredSamples]:
        """Return the samples of the detector, with scores uniform in [0, 1)."""
        drawn = self._detector.sample(scene, tasks, rng)
        return {
            task: replace(samples, scores=rng.random(len(samples.scores)))
            for task, samples in drawn.items()
        }


class ModelPerTask:
    """A detector each for some tasks.

    Attributes:
        config: how samples are drawn, the same for all.
    """

    config: SamplerConfig

    def __init__(self, detectors: Mapping[PoseTask, SamplingDetector]) -> None:
        configs = {detector.config for detector in detectors.values()}
        if len(configs) != 1:
            raise ValueError(f"the detectors have {len(configs)} configurations; expected one")
        self._detectors = dict(detectors)
        self.config = configs.pop()

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, ScoredSamples]:
        """Return the samples that the detector of each of `tasks` draws."""
        return {task: self._detectors[task].sample(scene, (task,), rng)[task] for task in tasks}


def make_detector(weights: tuple[Path, ...], ranked: bool) -> SamplingDetector:
    """Return a detector.

    Args:
        weights: one checkpoint for all tasks, or one each in the order of `TASKS`.
        ranked: whether it has its evaluator.

    Raises CheckpointError where a checkpoint cannot be used, ValueError for another number of them.
    """
    detector: SamplingDetector
    if len(weights) == 1:
        detector = SplitDetector.from_checkpoint(weights[0])
    elif len(weights) == len(TASKS):
        each = zip(TASKS, weights, strict=True)
        detector = ModelPerTask({task: SplitDetector.from_checkpoint(path) for task, path in each})
    else:
        raise ValueError(f"{len(weights)} checkpoints; expected 1 or {len(TASKS)}")
    return detector if ranked else ChanceRanking(detector)
