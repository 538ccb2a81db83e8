"""Recordings: what a trial looked like, as one HTML page that needs no server."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, MeshcatParams, Rgba
from pydrake.math import RigidTransform
from pydrake.perception import BaseField, Fields, PointCloud

from planning.problem import Plan
from scenarios.viewing.narration import Narration
from scenarios.viewing.pose_drawing import pose_segments, score_bands, thickened
from scenarios.viewing.replay_page import write_replay
from split_drake.pose_set import PoseSets
from split_drake.pose_task import GRASP
from split_drake.poses import Array, make_pose, rotation_x

FRAMES_PER_SECOND = 20.0
_CLOUD_RGB = (60, 90, 130)
_GRASP_RGBA = Rgba(0.1, 0.3, 0.9)
_GOAL_RGBA = Rgba(0.6, 0.1, 0.7)
_FORCE_RGBA = Rgba(0.9, 0.45, 0.0)
_VISUALIZER = "/drake/visualizer/panda"
_FINGERS = ("panda_leftfinger", "panda_rightfinger")
# Forces from which an arrow is one step longer, N; lengths of a step, and of an arrow's head.
_LEVELS_N = (2.0, 8.0, 20.0)
_ARROW_M, _HEAD_M = 0.015, 0.012
# Where arrows are, in a finger's frame: beside its outer side, as high as its pad.
_BESIDE_M, _TIP_HEIGHT_M = 0.025, 0.045
# More of a set than this hides the scene behind lines.
_SHOWN_POSES = 40


@contextmanager
def freeing_recorders() -> Iterator[None]:
    """Free, at the end and in this thread, the recorders that are used no longer by then.

    Drake ends the process where a Meshcat is freed in another thread than it was made in.  What
    Python has of a diagram refers to itself, so that it is freed by whichever thread happens to
    collect garbage: a progress bar's, say.

    What is there before is left out of the search, which would take longer than the rest of it.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.collect()
        gc.unfreeze()


def _point_cloud(p_WPs: Array) -> PointCloud:
    cloud = PointCloud(len(p_WPs), Fields(BaseField.kXYZs | BaseField.kRGBs))
    cloud.mutable_xyzs()[:] = p_WPs.T
    cloud.mutable_rgbs()[:] = np.array(_CLOUD_RGB, dtype=np.uint8)[:, None]
    return cloud


@dataclass(frozen=True)
class Viewpoint:
    """Where a recording is seen from.

    Attributes:
        p_WC: (3,) where the eye is.
        p_WTarget: (3,) what it looks at.
    """

    p_WC: tuple[float, float, float] = (1.05, 0.36, 0.62)
    p_WTarget: tuple[float, float, float] = (0.36, -0.17, 0.20)


class Recorder:
    """Records a simulation together with what was perceived and planned.

    The station publishes its motion to `meshcat`; times are the simulation's, in seconds.

    Attributes:
        meshcat: that is recorded.
        narration: what the page says while it plays, by the recording's own time.

    Args:
        viewpoint: where the recording is seen from.
        title: what is tried.
    """

    def __init__(self, viewpoint: Viewpoint | None = None, title: str = "") -> None:
        self.narration = Narration(title)
        self.meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
        self._viewpoint = viewpoint or Viewpoint()
        self._attempts = 0
        self._start_s = 0.0
        self._shown_levels: dict[str, int] = {}

    def start(self, time_s: float) -> None:
        """Record from `time_s`, which is now, on."""
        self._start_s = time_s
        self.meshcat.SetCameraPose(self._viewpoint.p_WC, self._viewpoint.p_WTarget)
        for helper in ("/Grid", "/Axes"):
            self.meshcat.SetProperty(helper, "visible", False)
        self.meshcat.StartRecording(
            frames_per_second=FRAMES_PER_SECOND, set_visualizations_while_recording=False
        )
        self.meshcat.get_mutable_recording().set_start_time(time_s)

    def show_perception(self, p_WPs: Array, pose_sets: PoseSets, time_s: float) -> None:
        """Show a cloud (N, 3) and pose sets from `time_s` on, instead of what was shown before."""
        if self._attempts:
            self._set_visible("", False, time_s)
        self._attempts += 1
        self.meshcat.SetObject(f"{self._path}/seen/cloud", _point_cloud(p_WPs), point_size=0.0025)
        for task, pose_set in pose_sets.items():
            for band, colored in enumerate(score_bands(pose_set.head(_SHOWN_POSES))):
                path = f"{self._path}/seen/{task}/band_{band}"
                self._draw(path, colored.segments_W, Rgba(*colored.color))
        for part in ("", "/seen"):
            # Before its first key a property has that key's value.
            if time_s > self._start_s:
                self._set_visible(part, False, self._start_s)
            self._set_visible(part, True, time_s)

    def show_plan(self, plan: Plan, taking: bool = True) -> None:
        """Show the chosen grasp, and where the hand and the placed frame shall end.

        A plan that does not take the object leaves the grasp as it was shown.
        """
        chosen = {
            "grasp": (GRASP, plan.X_WGrasp, _GRASP_RGBA),
            "grasp_at_goal": (GRASP, plan.X_WGplace, _GOAL_RGBA),
            "goal": (plan.subgoal.task, plan.X_WGoal, _GOAL_RGBA),
        }
        if not taking:
            del chosen["grasp"]
        for name, (task, X_WP, rgba) in chosen.items():
            segments = thickened(pose_segments(task, X_WP))
            self._draw(f"{self._path}/plan/{name}", segments, rgba)

    def show_grasp(self, X_WG: Array) -> None:
        """Show a grasp X_WG (4, 4) that was chosen of those perceived last."""
        segments = thickened(pose_segments(GRASP, X_WG))
        self._draw(f"{self._path}/seen/chosen", segments, _GRASP_RGBA)

    def hide_perception(self, time_s: float) -> None:
        """Hide cloud and pose sets from `time_s` on; the plan stays."""
        self._set_visible("/seen", False, time_s)

    def tell(self, time_s: float, attempt: int, name: str, near: bool = False) -> None:
        """Say from `time_s` on which segment of which attempt it is, see `Narration`."""
        self.narration.tell(time_s - self._start_s, attempt, name, near)

    def feel(self, time_s: float, forces_n: Array) -> None:
        """Show the fingers' forces (2,), newtons, inwards: arrows the longer the larger."""
        if not self.narration.feel(time_s - self._start_s, *map(float, forces_n)):
            return
        for finger, force_n in zip(_FINGERS, forces_n, strict=True):
            level = int(np.searchsorted(_LEVELS_N, force_n))
            if level == self._shown_levels.get(finger):
                continue
            for number in range(1, len(_LEVELS_N) + 1):
                path = f"{_VISUALIZER}/{finger}/force/{number}"
                if finger not in self._shown_levels:
                    self._draw_arrow(path, 1.0 if finger == _FINGERS[0] else -1.0, number)
                    if time_s > self._start_s:
                        self.meshcat.SetProperty(path, "visible", False, self._start_s)
                self.meshcat.SetProperty(path, "visible", number == level, time_s)
            self._shown_levels[finger] = level

    def _draw_arrow(self, path: str, side: float, level: int) -> None:
        """Draw an arrow beside a finger, in its frame, that points inwards."""
        length_m = _ARROW_M * level
        for part, shape, reach_m in (
            ("shaft", Cylinder(0.0025, length_m), length_m / 2.0 + _HEAD_M),
            ("head", MeshcatCone(_HEAD_M, 0.006, 0.006), 0.0),
        ):
            # Along the finger's y, from outside; a cone has its point at its origin, along +z.
            turn = rotation_x(-side * np.pi / 2.0)
            p = (0.0, side * (_BESIDE_M + reach_m), _TIP_HEIGHT_M)
            self.meshcat.SetObject(f"{path}/{part}", shape, _FORCE_RGBA)
            self.meshcat.SetTransform(f"{path}/{part}", RigidTransform(make_pose(turn, p)))

    def save(self, path: Path, outcome: str, good: bool) -> None:
        """Write the page, atomically, and the script that it shares with others of its folder.

        Args:
            path: of the page.
            outcome: what became of it, in words.
            good: whether that is what was wanted.
        """
        self.meshcat.StopRecording()
        self.meshcat.PublishRecording()
        self.narration.outcome, self.narration.good = outcome, good
        write_replay(path, self.meshcat.StaticHtml(), self.narration)

    @property
    def _path(self) -> str:
        return f"/perception/{self._attempts}"

    def _set_visible(self, part: str, visible: bool, time_s: float) -> None:
        self.meshcat.SetProperty(self._path + part, "visible", visible, time_s)

    def _draw(self, path: str, segments_W: Array, rgba: Rgba) -> None:
        start, end = (np.asfortranarray(segments_W[:, i].T) for i in (0, 1))
        self.meshcat.SetLineSegments(path, start, end, rgba=rgba)
