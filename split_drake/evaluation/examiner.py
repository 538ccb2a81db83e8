"""One scene of an evaluation: draw it, detect, and compare with the truth."""

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from split_drake.evaluation.record import SceneRecord
from split_drake.evaluation.scenes import EvalMugs, EvalOptions
from split_drake.evaluation.task_records import (
    Ranking,
    record_grasps,
    record_handles,
    record_uprights,
)
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene
from split_drake.split.detector import SamplerConfig, ScoredSamples
from split_drake.split.network import TASKS
from split_drake.station.layout import Layout


class SamplingDetector(Protocol):
    """What can be evaluated: `SplitDetector`, or what draws and scores samples as it does."""

    config: SamplerConfig

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, ScoredSamples]:
        """Return all samples for each of `tasks`."""


# Called in each worker process, so that it must be picklable, say a partial of a module's function.
DetectorMaker = Callable[[], SamplingDetector]


class Examiner:
    """Evaluates a detector on one scene after another.

    Scene i is a matter of the seed and i alone: its mug, how that lies, noise, the detector's
    chance and the choice of grasps that are tried come from streams of their own, so that every
    detector meets the same scenes.
    """

    def __init__(self, detector: SamplingDetector, mugs: EvalMugs, options: EvalOptions) -> None:
        self._detector = detector
        self._mugs = mugs
        self._options = options

    def examine(self, index: int) -> SceneRecord:
        """Return the record of scene `index`."""
        options, mug = self._options, self._mugs.of_scene(index)
        streams = np.random.SeedSequence([options.seed, index]).spawn(4)
        for_scene, for_noise, for_detector, for_choice = map(np.random.default_rng, streams)
        drawn = mug.draw(for_scene)
        seen = Scene(drawn.p_WPs, drawn.p_WSs, Layout().workspace)
        seen = seen.with_noise(options.noise_m, for_noise)
        start_s = time.perf_counter()
        samples = self._detector.sample(seen, TASKS, for_detector)
        detect_s = time.perf_counter() - start_s
        threshold = self._detector.config.threshold
        ranked = {task: Ranking(samples[task], threshold) for task in TASKS}
        physics = for_choice if index < options.physics_scenes else None
        return SceneRecord(
            index=index,
            mug=mug.shape.body.name,
            handle_points=drawn.handle_points,
            detect_s=round(detect_s, 4),
            tasks={
                PoseTask.GRASP: record_grasps(ranked[PoseTask.GRASP], mug, drawn, physics),
                PoseTask.HANDLE: record_handles(ranked[PoseTask.HANDLE], mug, drawn.X_WO),
                PoseTask.UPRIGHT: record_uprights(ranked[PoseTask.UPRIGHT], drawn.X_WO),
            },
        )
