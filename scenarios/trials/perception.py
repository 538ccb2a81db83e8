"""One look at the station: what the cameras see, made noisy, and what a detector finds in it."""

from collections.abc import Sequence

from scenarios.trials.detectors import make_detector
from scenarios.trials.setup import Setup, TrialGenerators
from scenarios.trials.spec import TrialSpec
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, PoseTask
from split_drake.scene import Scene


class Perceiver:
    """The eyes of a trial.

    Args:
        spec: of the trial.
        setup: whose station is looked at.
        rngs: that noise and detector draw from.
    """

    def __init__(self, spec: TrialSpec, setup: Setup, rngs: TrialGenerators) -> None:
        self._noise_m = spec.noise_m
        self._station = setup.station
        self._rngs = rngs
        self._detector = make_detector(spec, setup)
        self._wide_detector = make_detector(spec, setup, wide=True)

    def look(
        self, tasks: Sequence[PoseTask], again: bool = False
    ) -> tuple[Scene, dict[str, PoseSet]]:
        """Return the scene and the pose sets found in it, as `planning`'s `Perceive` asks.

        Raises EmptySceneError where nothing is seen in the workspace.
        """
        layout = self._station.config.layout
        clean = Scene.from_views(self._station.capture(), layout.workspace)
        scene = clean.with_noise(self._noise_m, self._rngs.noise)
        pose_sets = self._detector.detect(scene, tasks, self._rngs.detector)
        if again and GRASP in tasks:
            # Places that an object can be put to gather for good reason: only grasps spread.
            pose_sets |= self._wide_detector.detect(scene, [GRASP], self._rngs.detector)
        return scene, pose_sets
