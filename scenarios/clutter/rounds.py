"""One round of clutter removal, by VGN's protocol (arXiv 2101.01132).

Grasps are detected, one is tried, and what was taken is removed, until no object is left, no grasp
is found, or two grasps in a row fail.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from pydrake.geometry import Meshcat

from planning.clearing.drop_planner import DropPlanner
from scenarios.clutter.arm_clearing import ArmClearing, LostArmError
from scenarios.clutter.clearing import Clearing, HandClearing
from scenarios.clutter.detection import GraspFinder, clutter_detector, ranked
from scenarios.clutter.observation import observe, side_camera
from scenarios.clutter.records import (
    BROKEN,
    CRASHED,
    EMPTIED,
    ERROR,
    LOST_ARM,
    NO_GRASP,
    NO_PLAN,
    TOO_LONG,
    TWO_FAILURES,
    GraspRecord,
    RoundRecord,
)
from scenarios.clutter.spec import RoundSpec, draw_start, drawn_objects, round_station
from scenarios.viewing.recording import FRAMES_PER_SECOND, Recorder, Viewpoint, freeing_recorders
from split_drake.experiments.pool import WORKER_DIED
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.scene import EmptySceneError, Scene
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.station import Station
from split_drake.truth.removal import wait_for_all_to_rest
from split_drake.truth.state import Truth

NOTHING = ranked(np.empty((0, 4, 4)), ())
FAILURES_IN_A_ROW = 2
# The hand is seen from beside the camera, the arm with its bin from further away.
_VIEWPOINTS = {
    "hand": Viewpoint((0.62, -0.42, 0.30), (0.5, 0.0, 0.05)),
    "arm": Viewpoint((0.95, -0.65, 0.60), (0.27, -0.17, 0.08)),
}


def run_round(spec: RoundSpec) -> RoundRecord:
    """Run a round; one whose simulation fails is recorded as far as it came."""
    logging.getLogger("drake").setLevel(logging.ERROR)
    started_s = time.monotonic()
    with freeing_recorders():
        record = ClutterRound(spec).run()
    return replace(record, wall_s=time.monotonic() - started_s)


def crashed_round(spec: RoundSpec, reason: str = WORKER_DIED) -> RoundRecord:
    """Return the record of a round whose process died, or was killed."""
    ended = CRASHED if reason == WORKER_DIED else TOO_LONG
    return RoundRecord(spec.seed, spec.index, (), (), ended, "" if ended == CRASHED else reason)


@lru_cache(maxsize=1)
def drop_planner() -> DropPlanner:
    """Return this process's planner; it keeps its collision world."""
    return DropPlanner()


def _title(spec: RoundSpec) -> str:
    """Return what a recording is called."""
    return f"round {spec.seed}-{spec.index}, {spec.scene}, {spec.detector}"


class ClutterRound:
    """A round on its station."""

    def __init__(self, spec: RoundSpec) -> None:
        self._start_rng, self._noise_rng, self._rng = spec.streams()
        self._spec = spec
        viewpoint = _VIEWPOINTS[spec.robot]
        self._recorder = None if spec.record == "none" else Recorder(viewpoint, _title(spec))
        self._grasps: list[GraspRecord] = []
        self._names: tuple[str, ...] = ()

    def run(self) -> RoundRecord:
        """Return what became of the round."""
        try:
            clearing = self._set_up()
            if self._recorder:
                self._recorder.start(clearing.time_s)
            ended, detail = self._empty_table(clearing)
        except LostArmError as error:
            ended, detail = LOST_ARM, str(error)
        except RuntimeError as error:  # Drake's contact solver
            ended, detail = BROKEN, str(error).partition("\n")[0]
        except Exception as error:
            ended, detail = ERROR, f"{type(error).__name__}: {error}".partition("\n")[0]
        spec, grasps = self._spec, tuple(self._grasps)
        record = RoundRecord(spec.seed, spec.index, self._names, grasps, ended, detail)
        return replace(record, recording=self._save_recording(record))

    def _set_up(self) -> Clearing:
        """Return the table as the round begins, and what clears it.

        The start is drawn with the hand, whatever clears the table then.
        """
        spec, objects = self._spec, drawn_objects(self._spec, self._start_rng)
        with_hand, config = spec.robot == "hand", round_station(spec.layout)
        meshcat = self._meshcat if with_hand else None
        station = HandStation(objects, spec.layout, config, meshcat)
        start = draw_start(spec, station, self._start_rng)
        self._names = tuple(objects[index].name for index in start.indices)
        if with_hand:
            station.discard_parked()
            return HandClearing(station, side_camera(spec.layout.workspace))
        config = replace(config, meshcat_rate_hz=FRAMES_PER_SECOND)
        there = [objects[index] for index in start.indices]
        arm = Station(config, there, self._meshcat, bearing=True)
        for index, X_WO in enumerate(start.X_WOs):
            arm.place_object(index, X_WO)
        wait_for_all_to_rest(arm, Truth(arm))
        return ArmClearing(arm, drop_planner(), self._rng)

    @property
    def _meshcat(self) -> Meshcat | None:
        return self._recorder.meshcat if self._recorder else None

    def _save_recording(self, record: RoundRecord) -> str | None:
        """Keep the recording where it is wanted; return the page's name."""
        if self._recorder is None or not record.objects:
            return None
        if self._spec.record == "failures" and record.ended == EMPTIED and record.clean:
            return None
        name = f"recordings/{record.seed:03d}-{record.index:03d}.html"
        self._recorder.save(self._spec.folder / name, record.ended, record.ended == EMPTIED)
        return name

    def _empty_table(self, clearing: Clearing) -> tuple[str, str]:
        """Try grasps until the round ends; return why it did, and any details."""
        detector = self._detector(clearing)
        failures = 0
        while clearing.left:
            scene = self._look(clearing)
            found = NOTHING if scene is None else detector.detect(scene, self._rng)
            if scene is not None and self._recorder:
                found_by_task = {GRASP.name: found}
                self._recorder.show_perception(scene.p_WPs, found_by_task, clearing.time_s)
            if scene is None or not len(found):
                return NO_GRASP, ""
            chosen = clearing.choose(found, scene, self._order(found))
            if isinstance(chosen, str):
                return NO_PLAN, chosen
            if self._recorder:
                self._recorder.show_grasp(found.X_WPs[chosen])
                number = len(self._grasps) + 1
                self._recorder.tell(clearing.time_s, number, f"grasp {number}")
            self._grasps.append(clearing.take(found, chosen))
            failures = 0 if self._grasps[-1].succeeded else failures + 1
            if failures == FAILURES_IN_A_ROW:
                return TWO_FAILURES, ""
        return EMPTIED, ""

    def _detector(self, clearing: Clearing) -> GraspFinder:
        method = clutter_detector(self._spec.detector, self._spec.checkpoint)
        return method.make(self._spec.checkpoint, clearing, self._rng)

    def _look(self, clearing: Clearing) -> Scene | None:
        """Return what is seen now, or None where the view shows nothing."""
        spec, view = self._spec, clearing.look()
        workspace = spec.layout.workspace
        try:
            return observe(view, workspace, spec.noise, self._noise_rng, spec.fit_table)
        except EmptySceneError:
            return None

    def _order(self, found: PoseSet) -> Sequence[int]:
        """Return the indices of the grasps in the order in which they are to be tried."""
        if self._spec.select == "random":
            return [int(index) for index in self._rng.permutation(len(found))]
        return range(len(found))
