"""A Drake system that turns depth images into pose sets with any detector."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from split_drake.pose_set import PoseDetector
from split_drake.pose_task import PoseTask
from split_drake.sensing.table_noise import scene_above_noise
from split_drake.station.cameras.depth_cameras import depth_view
from split_drake.station.layout import Layout


class PoseDetectorSystem(LeafSystem):
    """Runs a detector on what the depth cameras see; the results are kept until an input changes.

    Input ports:
        <camera>: the depth image of each camera of the layout.
    Output ports:
        scene: abstract, Scene with noise.
        pose_sets: abstract, dict[str, PoseSet] by the tasks' names.

    Args:
        detector: any PoseDetector.
        tasks: what to detect.
        layout: gives workspace, cameras and their poses.
        noise_m: standard deviation of the noise on the scene's sampled points.
        seed: of noise and detector, the same at each evaluation.
    """

    def __init__(
        self,
        detector: PoseDetector,
        tasks: Sequence[PoseTask | str],
        layout: Layout,
        noise_m: float = 0.0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        if noise_m < 0.0:
            raise ValueError(f"noise_m is {noise_m}; expected a standard deviation >= 0 in metres")
        self._detector = detector
        self._tasks = tuple(tasks)
        self._layout = layout
        self._noise_m = noise_m
        self._seed = seed
        for placement in layout.cameras:
            self.DeclareAbstractInputPort(placement.name, Value[ImageDepth32F]())
        inputs = {self.all_input_ports_ticket()}
        self._scene = self.DeclareAbstractOutputPort(
            "scene", lambda: AbstractValue.Make(object()), self._calc_scene, inputs
        )
        self.DeclareAbstractOutputPort(
            "pose_sets", lambda: AbstractValue.Make({}), self._calc_pose_sets, inputs
        )

    def _calc_scene(self, context: Context, output: AbstractValue) -> None:
        views = [
            depth_view(self.GetInputPort(placement.name).Eval(context), placement)
            for placement in self._layout.cameras
        ]
        scene = scene_above_noise(views, self._layout.workspace)
        output.set_value(scene.with_noise(self._noise_m, np.random.default_rng((self._seed, 0))))

    def _calc_pose_sets(self, context: Context, output: AbstractValue) -> None:
        rng = np.random.default_rng((self._seed, 1))
        output.set_value(self._detector.detect(self._scene.Eval(context), self._tasks, rng))
