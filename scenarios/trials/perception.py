"""One look at the station: what the cameras see, made noisy, and what a detector finds in it."""

from collections.abc import Sequence
from dataclasses import dataclass

from scenarios.trials.detectors import make_detector
from scenarios.trials.setup import Setup, TrialGenerators
from scenarios.trials.spec import TrialSpec
from split_drake.pose_set import PoseSet
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene


@dataclass(frozen=True)
class Perceiver:
    """The eyes of a trial.

    Attributes:
        spec: of the trial.
        setup: whose station is looked at.
        rngs: that noise and detector draw from.
    """

    spec: TrialSpec
    setup: Setup
    rngs: TrialGenerators

    def look(
        self, tasks: Sequence[PoseTask], again: bool = False
    ) -> tuple[Scene, dict[PoseTask, PoseSet]]:
        """Return the scene and the pose sets found in it, as `planning`'s `Perceive` asks.

        Raises EmptySceneError where nothing is seen in the workspace.
        """
        station = self.setup.station
        clean = Scene.from_views(station.capture(), station.config.layout.workspace)
        scene = clean.with_noise(self.spec.noise_m, self.rngs.noise)
        detector = make_detector(self.spec, self.setup)
        pose_sets = detector.detect(scene, tasks, self.rngs.detector)
        if again and PoseTask.GRASP in tasks:
            # Places that an object can be put to gather for good reason: only grasps spread.
            wide = make_detector(self.spec, self.setup, wide=True)
            pose_sets |= wide.detect(scene, [PoseTask.GRASP], self.rngs.detector)
        return scene, pose_sets
