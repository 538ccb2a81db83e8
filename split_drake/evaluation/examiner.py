"""One scene of an evaluation: draw it, detect, and compare with the truth."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from split_drake.evaluation.judges import record_task
from split_drake.evaluation.record import SceneRecord
from split_drake.evaluation.scenes import EvalOptions, EvalSubject, EvalSubjects
from split_drake.evaluation.task_records import Question, Ranking
from split_drake.pose_set import ALL_ACCEPTED, PoseDetector, SamplingDetector, ScoredPoses
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene

# Called in each worker process, so that it must be picklable, say a partial of a module's function.
DetectorMaker = Callable[[], PoseDetector]


class Examiner:
    """Evaluates a detector on one scene after another.

    Scene i is a matter of the seed and i alone: its object, how that lies, noise, the detector's
    chance and the choice of grasps that are tried come from streams of their own, so that every
    detector meets the same scenes.

    Args:
        detector: any; of one that samples all samples are judged, of others the poses returned.
        tasks: that it is asked for.
        subjects: the objects.
        options: of the scenes.
    """

    def __init__(
        self,
        detector: PoseDetector,
        tasks: Sequence[PoseTask],
        subjects: EvalSubjects,
        options: EvalOptions,
    ) -> None:
        self._detector = detector
        self._tasks = tuple(tasks)
        self._subjects = subjects
        self._options = options
        self._made: dict[int, EvalSubject] = {}

    def examine(self, index: int) -> SceneRecord:
        """Return the record of scene `index`."""
        options, subject = self._options, self._subject(index)
        streams = np.random.SeedSequence([options.seed, index]).spawn(4)
        for_scene, for_noise, for_detector, for_choice = map(np.random.default_rng, streams)
        drawn = subject.draw(for_scene)
        seen = Scene(drawn.p_WPs, drawn.p_WSs, self._subjects.layout.workspace)
        seen = seen.with_noise(options.noise_m, for_noise)
        start_s = time.perf_counter()
        ranked = self._rank(seen, for_detector)
        detect_s = time.perf_counter() - start_s
        physics = for_choice if index < options.physics_scenes else None
        return SceneRecord(
            index=index,
            subject=subject.shape.name,
            feature_points=drawn.feature_points,
            detect_s=round(detect_s, 4),
            tasks={
                task.name: record_task(Question(task, ranked[task.name], subject, drawn, physics))
                for task in self._tasks
            },
        )

    def _subject(self, index: int) -> EvalSubject:
        """Return the object of scene `index`: they take turns."""
        number = index % len(self._subjects.names())
        if number not in self._made:
            self._made[number] = self._subjects.make(number, self._options.seed)
        return self._made[number]

    def _rank(self, scene: Scene, rng: np.random.Generator) -> dict[str, Ranking]:
        """Return what the detector draws for each task, by the tasks' names."""
        if isinstance(self._detector, SamplingDetector):
            acceptance = self._detector.acceptance
            drawn = self._detector.sample(scene, self._tasks, rng)
            return {name: Ranking(samples, acceptance) for name, samples in drawn.items()}
        found = self._detector.detect(scene, self._tasks, rng)
        return {
            name: Ranking(ScoredPoses(poses.X_WPs, poses.scores), ALL_ACCEPTED)
            for name, poses in found.items()
        }
