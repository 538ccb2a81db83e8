"""Everything that determines a round of clutter removal, and what lies there when it starts."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from scenarios.clutter.observation import Noise
from split_drake.objects.files.folder import ObjectFolder
from split_drake.objects.procedural.split import ProceduralSource, Split
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import ObjectSource
from split_drake.station.config import StationConfig
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.truth.clutter_starts import (
    OBJECTS,
    PACKED_ATTEMPTS,
    ClutterStart,
    packed_start,
    pile_start,
)
from split_drake.truth.state import Truth

SceneKind = Literal["packed", "pile"]
Selection = Literal["best", "random"]
Recorded = Literal["all", "failures", "none"]
Robot = Literal["hand", "arm"]

SCALES: dict[str, tuple[float, float]] = {"packed": (0.7, 0.9), "pile": (0.8, 1.0)}
PROCEDURAL: dict[str, Split] = {"procedural": "test", "procedural-train": "train"}


@dataclass(frozen=True)
class RoundSpec:
    """Everything that determines a round.

    Attributes:
        seed, index: of its draws; with the same ones every detector meets the same start.
        scene: how objects lie when it starts.
        objects: where they come from, see `object_source`.
        names: of these; a start is drawn from them, wherever it is drawn.
        detector: the method that finds grasps, see `clutter_detectors`.
        checkpoint: its parameters, where it has any.
        noise: of what it sees.
        fit_table: put the scale of what it sees right by the table.
        select: which of the grasps is tried.
        layout: of table and workspace, and of the arm's bin.
        robot: what takes the objects.
        record: which rounds keep a recording.
        folder: of the run, in which it is kept.
    """

    seed: int
    index: int
    scene: SceneKind
    objects: ObjectSource
    names: tuple[str, ...]
    detector: str
    checkpoint: Path | None
    noise: Noise
    fit_table: bool
    select: Selection
    layout: Layout
    robot: Robot
    record: Recorded
    folder: Path

    def streams(self) -> list[np.random.Generator]:
        """Return what start, noise, and the rest are drawn from.

        Each has a stream of its own, so that starts are the same for all detectors, noises and
        robots.
        """
        parts = np.random.SeedSequence([self.seed, self.index]).spawn(3)
        return [np.random.default_rng(part) for part in parts]


def object_source(objects: str, cache: Path) -> ObjectSource:
    """Return where the objects that are called so come from.

    Convex decompositions of a folder's meshes are kept in `cache`.  Raises ObjectFileError where
    they are called as a folder that is none.
    """
    if objects in PROCEDURAL:
        return ProceduralSource(PROCEDURAL[objects])
    return ObjectFolder(Path(objects), cache)


def round_station(layout: Layout) -> StationConfig:
    """Return what the stations of rounds are like, with the hand and with the arm."""
    return StationConfig(layout)


def drawn_objects(spec: RoundSpec, rng: np.random.Generator) -> list[RigidObject]:
    """Return objects drawn with replacement and scaled, named by their number too."""
    source, names = spec.objects, spec.names
    count = PACKED_ATTEMPTS if spec.scene == "packed" else OBJECTS
    low, high = SCALES[spec.scene]
    drawn = [
        (names[int(rng.integers(len(names)))], float(rng.uniform(low, high))) for _ in range(count)
    ]
    return [
        replace(source.load(name).body.scaled(scale), name=f"{name}#{number}")
        for number, (name, scale) in enumerate(drawn)
    ]


def draw_start(spec: RoundSpec, station: HandStation, rng: np.random.Generator) -> ClutterStart:
    """Put the station's objects on the table as the round begins.

    Raises RuntimeError where Drake's contact solver fails.
    """
    start = packed_start if spec.scene == "packed" else pile_start
    return start(station, Truth(station), rng)
