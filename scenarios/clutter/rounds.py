"""One round of clutter removal, by VGN's protocol (arXiv 2101.01132).

Grasps are detected, one is tried, and what the hand took is removed, until no object is left, no
grasp is found, or two grasps in a row fail.
"""

import logging
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from scenarios.clutter.detection import DetectorName, SplitGrasps, TrueGrasps, ranked
from scenarios.clutter.observation import Noise, observe, side_camera
from scenarios.clutter.records import (
    BROKEN,
    CRASHED,
    EMPTIED,
    NO_GRASP,
    TWO_FAILURES,
    GraspRecord,
    RoundRecord,
)
from scenarios.viewing.recording import Recorder, Viewpoint
from split_drake.objects.files.folder import ObjectFolder
from split_drake.objects.procedural.split import ProceduralSource, Split
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import ObjectSource
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.scene import EmptySceneError
from split_drake.station.hand.grasp_execution import execute_grasp
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.truth.clutter_starts import OBJECTS, PACKED_ATTEMPTS, packed_start, pile_start
from split_drake.truth.removal import clear_away, clutter_truth
from split_drake.truth.state import Truth

SceneKind = Literal["packed", "pile"]
Selection = Literal["best", "random"]
Recorded = Literal["all", "failures", "none"]

SCALES: dict[str, tuple[float, float]] = {"packed": (0.7, 0.9), "pile": (0.8, 1.0)}
FAILURES_IN_A_ROW = 2
# From beside the camera.
_VIEWPOINT = Viewpoint((0.62, -0.42, 0.30), (0.5, 0.0, 0.05))
PROCEDURAL: dict[str, Split] = {"procedural": "test", "procedural-train": "train"}


@dataclass(frozen=True)
class RoundSpec:
    """Everything that determines a round.

    Attributes:
        seed, index: of its draws; with the same ones every detector meets the same start.
        scene: how objects lie when it starts.
        objects: where they come from, see `object_source`.
        cache: where convex decompositions of a folder's meshes are kept.
        detector: which grasps are found.
        checkpoint: of SPLIT.
        noise: of what it sees.
        fit_table: put the scale of what it sees right by the table.
        select: which of the grasps is tried.
        layout: of table and workspace.
        record: which rounds keep a recording.
        folder: of the run, in which it is kept.
    """

    seed: int
    index: int
    scene: SceneKind
    objects: str
    cache: Path
    detector: DetectorName
    checkpoint: Path | None
    noise: Noise
    fit_table: bool
    select: Selection
    layout: Layout
    record: Recorded
    folder: Path

    def streams(self) -> list[np.random.Generator]:
        """Return what start, noise, and the rest are drawn from.

        Each has a stream of its own, so that starts are the same for all detectors and noises.
        """
        parts = np.random.SeedSequence([self.seed, self.index]).spawn(3)
        return [np.random.default_rng(part) for part in parts]


def object_source(objects: str, cache: Path) -> ObjectSource:
    """Return where the objects that are called so come from.

    Raises ObjectFileError where they are called as a folder that is none.
    """
    if objects in PROCEDURAL:
        return ProceduralSource(PROCEDURAL[objects])
    return ObjectFolder(Path(objects), cache)


def run_round(spec: RoundSpec) -> RoundRecord:
    """Run a round; one whose simulation fails is recorded as far as it came."""
    logging.getLogger("drake").setLevel(logging.ERROR)
    started_s = time.monotonic()
    record = ClutterRound(spec).run()
    return replace(record, wall_s=time.monotonic() - started_s)


def crashed_round(spec: RoundSpec) -> RoundRecord:
    """Return the record of a round whose process died."""
    return RoundRecord(spec.seed, spec.index, (), (), CRASHED)


def drawn_objects(spec: RoundSpec, rng: np.random.Generator) -> list[RigidObject]:
    """Return objects drawn with replacement and scaled, named by their number too."""
    source = object_source(spec.objects, spec.cache)
    names, count = source.names(), PACKED_ATTEMPTS if spec.scene == "packed" else OBJECTS
    low, high = SCALES[spec.scene]
    drawn = [
        (names[int(rng.integers(len(names)))], float(rng.uniform(low, high))) for _ in range(count)
    ]
    return [
        replace(source.load(name).body.scaled(scale), name=f"{name}#{number}")
        for number, (name, scale) in enumerate(drawn)
    ]


class ClutterRound:
    """A round on its station."""

    def __init__(self, spec: RoundSpec) -> None:
        self._start_rng, self._noise_rng, self._rng = spec.streams()
        self._spec = spec
        self._recorder = None if spec.record == "none" else Recorder(_VIEWPOINT)
        meshcat = self._recorder.meshcat if self._recorder else None
        objects = drawn_objects(spec, self._start_rng)
        self._station = HandStation(objects, spec.layout, meshcat=meshcat)
        self._truth: Truth = clutter_truth(self._station)
        self._camera = side_camera(spec.layout.workspace)
        self._grasps: list[GraspRecord] = []
        self._detector: SplitGrasps | TrueGrasps
        if spec.detector == "oracle":
            self._detector = TrueGrasps(self._station, self._truth, self._rng)
        else:
            assert spec.checkpoint is not None  # checked by the options
            self._detector = SplitGrasps(spec.checkpoint)

    def run(self) -> RoundRecord:
        """Return what became of the round."""
        names: tuple[str, ...] = ()
        try:
            start = packed_start if self._spec.scene == "packed" else pile_start
            indices = start(self._station, self._truth, self._start_rng).indices
            names = tuple(self._station.objects[index].name for index in indices)
            if self._recorder:
                self._recorder.start(self._station.time_s)
            ended = self._empty_table()
        except RuntimeError as error:  # Drake's contact solver
            ended = f"{BROKEN}: {error}".splitlines()[0]
        record = RoundRecord(self._spec.seed, self._spec.index, names, tuple(self._grasps), ended)
        return replace(record, recording=self._save_recording(record))

    def _save_recording(self, record: RoundRecord) -> str | None:
        """Keep the recording where it is wanted; return the page's name."""
        if self._recorder is None or not record.objects:
            return None
        if self._spec.record == "failures" and record.ended == EMPTIED and record.clean:
            return None
        name = f"recordings/{record.seed:03d}-{record.index:03d}.html"
        self._recorder.save(self._spec.folder / name)
        return name

    def _empty_table(self) -> str:
        """Try grasps until the round ends, and return why it did."""
        failures = 0
        while self._station.present:
            found = self._look()
            if not len(found.scores):
                return NO_GRASP
            chosen = 0
            if self._spec.select == "random":
                chosen = int(self._rng.integers(len(found.scores)))
            failures = 0 if self._try(found, chosen) else failures + 1
            if failures == FAILURES_IN_A_ROW:
                return TWO_FAILURES
        return EMPTIED

    def _look(self) -> PoseSet:
        """Return the grasps that are found now; none where the view shows nothing."""
        (view,) = self._station.capture([self._camera])
        spec = self._spec
        try:
            scene = observe(
                view, spec.layout.workspace, spec.noise, self._noise_rng, spec.fit_table
            )
        except EmptySceneError:
            return ranked(np.empty((0, 4, 4)), ())
        found = self._detector.detect(scene, self._rng)
        if self._recorder:
            self._recorder.show_perception(scene.p_WPs, {GRASP.name: found}, self._station.time_s)
        return found

    def _try(self, found: PoseSet, chosen: int) -> bool:
        """Try a grasp, remove what it took, and return whether it took something."""
        X_WG = found.X_WPs[chosen]
        if self._recorder:
            self._recorder.show_grasp(X_WG)
        execution = execute_grasp(self._station, X_WG)
        removal = clear_away(
            self._station, self._truth, execution.held if execution.success else ()
        )
        self._grasps.append(
            GraspRecord(
                X_WG=X_WG.tolist(),
                score=float(found.scores[chosen]),
                candidates=len(found.scores),
                taken=self._names(removal.taken),
                lost=self._names(removal.lost),
                stopped_by=execution.stopped_by,
                reason=execution.reason,
            )
        )
        return execution.success

    def _names(self, indices: tuple[int, ...]) -> tuple[str, ...]:
        return tuple(self._station.objects[index].name for index in indices)
