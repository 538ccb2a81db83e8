"""One look at the station: what the cameras see, made noisy, and what a detector finds in it."""

from collections.abc import Sequence

from scenarios.trials.detection import trial_detector
from scenarios.trials.setup import Setup, TrialGenerators
from scenarios.trials.spec import TrialSpec
from split_drake.objects_in_view import scenes_of_objects
from split_drake.pose_set import PoseSet, merged_pose_sets
from split_drake.pose_task import GRASP, PoseTask
from split_drake.scene import Scene
from split_drake.sensing.table_noise import scene_above_noise


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
        self._detectors = trial_detector(spec.detector).make(spec, setup)

    def look(
        self, tasks: Sequence[PoseTask], again: bool = False
    ) -> tuple[Scene, dict[str, PoseSet]]:
        """Return the scene and the pose sets found in it, as `planning`'s `Perceive` asks.

        Where several objects are in view, each is looked at alone.

        Raises EmptySceneError where nothing is seen in the workspace.
        """
        layout = self._station.config.layout
        clean = scene_above_noise(self._station.capture(), layout.workspace)
        scenes = [
            each.with_noise(self._noise_m, self._rngs.noise) for each in scenes_of_objects(clean)
        ]
        found = merged_pose_sets([self._detect(scene, tasks, again) for scene in scenes])
        return scenes[0] if len(scenes) == 1 else clean, found

    def _detect(self, scene: Scene, tasks: Sequence[PoseTask], again: bool) -> dict[str, PoseSet]:
        detectors, rng = self._detectors, self._rngs.detector
        if not again:
            return detectors.usual.detect(scene, tasks, rng)
        # Places that an object can be put to gather for good reason: only grasps spread.
        goals = [task for task in tasks if task != GRASP]
        pose_sets = detectors.again.detect(scene, goals, rng) if goals else {}
        if GRASP in tasks:
            pose_sets |= detectors.again_for_grasps.detect(scene, [GRASP], rng)
        return pose_sets
