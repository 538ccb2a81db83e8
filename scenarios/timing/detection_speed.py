"""How long SPLIT's detections take beside VGN's planner, on one stored scene.

256 poses are drawn and scored for each task, of which the accepted ones are returned.  VGN starts
from a TSDF that is fused already.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.timing.turns import medians_in_turns
from split_drake.baselines.tsdf import fused_tsdf
from split_drake.baselines.vgn.detector import VgnDetector
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.models_folder import MODELS_FOLDER
from split_drake.pose_set import PoseSets
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask
from split_drake.scene import Scene, Workspace
from split_drake.sensing.camera_file import read_cameras
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.detector import CLUTTER_SAMPLER, SplitDetector
from split_drake.split.threads import on_threads

VGN, MUG_GRASPS, CLUTTER_GRASPS, ALL_TASKS = (
    "VGN's planner",
    "256 grasps of a mug",
    "256 grasps in clutter",
    "three pose sets of a mug",
)
_IMAGES = ("top.png", "side.png")


@dataclass(frozen=True)
class DetectionSpeed:
    """What detections take with a number of threads.

    Attributes:
        threads: of PyTorch.
        seconds: median of each kind of detection, and of VGN's planner.
    """

    threads: int
    seconds: Mapping[str, float]

    def ratio(self, name: str) -> float:
        """Return the time of a kind of detection in units of that of VGN's planner."""
        return self.seconds[name] / self.seconds[VGN]


def example_scene() -> Scene:
    """Return the scene of the images that ship with the project."""
    file = read_cameras(MODELS_FOLDER / "examples" / "cameras.yaml")
    shots = zip(file.cameras, _IMAGES, strict=True)
    views = [camera.view(MODELS_FOLDER / "examples" / image) for camera, image in shots]
    return Scene.from_views(views, file.workspace or Workspace())


def detection_speeds(threads: Sequence[int], rounds: int) -> list[DetectionSpeed]:
    """Return what detections take with each number of threads, each kind in turns."""
    calls = _calls(example_scene())
    found = []
    for count in threads:
        with on_threads(count):
            found.append(DetectionSpeed(count, medians_in_turns(calls, rounds)))
    return found


def _calls(scene: Scene) -> dict[str, Callable[[], object]]:
    """Return what is timed; VGN's time does not depend on its weights."""
    mugs = SplitDetector(load_checkpoint(default_weights())[0], scene.workspace)
    weights = default_weights().with_name("split_clutter.safetensors")
    clutter = SplitDetector(load_checkpoint(weights)[0], scene.workspace, CLUTTER_SAMPLER)
    vgn, field = VgnDetector(VgnNetwork()), fused_tsdf(scene.views, scene.workspace)

    def found(detector: SplitDetector, tasks: Sequence[PoseTask]) -> PoseSets:
        return detector.detect(scene, tasks, np.random.default_rng(0))

    return {
        VGN: lambda: vgn.grasps(field, scene.workspace),
        MUG_GRASPS: lambda: found(mugs, (GRASP,)),
        CLUTTER_GRASPS: lambda: found(clutter, (GRASP,)),
        ALL_TASKS: lambda: found(mugs, MUG_TASKS),
    }
