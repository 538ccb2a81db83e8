"""Detectors that the ablation puts together from trained models."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from split_drake.pose_set import (
    ALL_ACCEPTED,
    PoseSet,
    SamplingDetector,
    ScoredPoses,
    accepted_poses,
)
from split_drake.pose_task import PoseTask, find_tasks
from split_drake.scene import Scene
from split_drake.split.detector import SplitDetector


class ChanceRanking:
    """A detector without its evaluator: chance ranks the samples, and none is rejected.

    Attributes:
        tasks: that it knows.
        acceptance: of the samples' scores.
    """

    def __init__(self, detector: SamplingDetector, tasks: Sequence[PoseTask]) -> None:
        self._detector = detector
        self.tasks = tuple(tasks)
        self.acceptance = ALL_ACCEPTED

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, ScoredPoses]:
        """Return the samples of the detector, with scores uniform in [0, 1)."""
        drawn = self._detector.sample(scene, tasks, rng)
        return {
            name: replace(samples, scores=rng.random(len(samples.scores)))
            for name, samples in drawn.items()
        }

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return the accepted samples for each of `tasks`, by their names."""
        known = find_tasks(tasks, self.tasks, "the detector")
        return accepted_poses(self.sample(scene, known, rng), known, self.acceptance)


class ModelPerTask:
    """A detector each for some tasks.

    Attributes:
        tasks: that it knows.
        acceptance: of the samples' scores, the same for all.
    """

    def __init__(self, detectors: Mapping[PoseTask, SamplingDetector]) -> None:
        found = {detector.acceptance for detector in detectors.values()}
        if len(found) != 1:
            raise ValueError(f"the detectors accept scores in {len(found)} ways; expected one")
        self._detectors = {task.name: detector for task, detector in detectors.items()}
        self.tasks = tuple(detectors)
        self.acceptance = found.pop()

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, ScoredPoses]:
        """Return the samples that the detector of each of `tasks` draws."""
        names = [task.name for task in find_tasks(tasks, self.tasks, "the detector")]
        return {name: self._detectors[name].sample(scene, (name,), rng)[name] for name in names}

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return the accepted samples for each of `tasks`, by their names."""
        known = find_tasks(tasks, self.tasks, "the detector")
        return accepted_poses(self.sample(scene, known, rng), known, self.acceptance)


def make_detector(weights: tuple[Path, ...], ranked: bool) -> SamplingDetector:
    """Return a detector.

    Args:
        weights: one checkpoint for all tasks, or one each for a task of its own.
        ranked: whether it has its evaluator.

    Raises CheckpointError where a checkpoint cannot be used, ValueError where there is none, or
    several do not know one task each.
    """
    if not weights:
        raise ValueError("no checkpoints; expected at least one")
    each = [SplitDetector.from_checkpoint(path) for path in weights]
    tasks = tuple(task for detector in each for task in detector.tasks)
    detector: SamplingDetector = each[0]
    if len(each) > 1:
        if not len(set(tasks)) == len(tasks) == len(each):
            known = ", ".join(map(str, tasks))
            raise ValueError(f"{len(each)} checkpoints know {known}; expected one task each")
        detector = ModelPerTask(dict(zip(tasks, each, strict=True)))
    return detector if ranked else ChanceRanking(detector, tasks)
