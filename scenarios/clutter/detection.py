"""Methods that find grasps in clutter, by name.

A method is a file in `scenarios/clutter/detectors/` with a constant `DETECTOR`; nothing else has to
know of it.  The same rounds, views and noise are shown to all of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from scenarios.clutter.clearing import Clearing
from split_drake.bad_input import BadInputError
from split_drake.experiments.room_files import constants_in
from split_drake.pose_set import PoseDetector, PoseSet
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import Layout

_ROOM = "scenarios.clutter.detectors"
TRAINED_OR_PUBLISHED = "weights trained here (.safetensors), or published by its authors (.pt)"


class GraspFinder(Protocol):
    """Finds grasps in what is seen of a round."""

    def detect(self, scene: Scene, rng: np.random.Generator) -> PoseSet:
        """Return the accepted grasps, best first."""
        ...


def usual_workspace(checkpoint: Path | None) -> Workspace:
    """Return the usual cube, whatever the checkpoint."""
    return Layout().workspace


@dataclass(frozen=True)
class ClutterDetector:
    """A method by name.

    Attributes:
        name: what it is called on the command line.
        checkpoint: what file its parameters are from, in words; empty for none.
        make: returns what finds grasps in a round, given that file, what clears the table, and what
            it may draw from once.  Called once a round: what is expensive should be kept.
        check: raises BadInputError where that file is of no use, before the first round.
        workspace: returns the cube that its scenes are cropped to, given that file.
    """

    name: str
    checkpoint: str
    make: Callable[[Path | None, Clearing, np.random.Generator], GraspFinder]
    check: Callable[[Path | None], None] = lambda path: None
    workspace: Callable[[Path | None], Workspace] = usual_workspace


class TaskDetector(PoseDetector, Protocol):
    """A detector that says which tasks it knows."""

    @property
    def tasks(self) -> Sequence[PoseTask]: ...


class UnknownDetectorError(BadInputError):
    """There is no method of that name, or its file is missing."""


@lru_cache(maxsize=1)
def clutter_detectors() -> Mapping[str, ClutterDetector]:
    """Return all methods by their names.

    Raises ValueError where a file of the room has none, or two have the same name.
    """
    return constants_in(_ROOM, "DETECTOR", ClutterDetector, lambda each: each.name)


def clutter_detector(name: str, checkpoint: Path | None) -> ClutterDetector:
    """Return a method that can be made with that checkpoint.

    Raises UnknownDetectorError where it is unknown, lacks a checkpoint, or takes none.
    """
    known = clutter_detectors()
    if name not in known:
        raise UnknownDetectorError(
            f"--detector is {name!r}; expected one of {', '.join(sorted(known))}"
        )
    wanted = known[name].checkpoint
    if wanted and checkpoint is None:
        raise UnknownDetectorError(f"--detector {name} needs --checkpoint: {wanted}")
    if checkpoint is not None and not wanted:
        raise UnknownDetectorError(f"--detector {name} has no parameters; leave --checkpoint out")
    if checkpoint is not None and not checkpoint.is_file():
        raise UnknownDetectorError(f"--checkpoint: there is no file {checkpoint}")
    return known[name]


@dataclass(frozen=True)
class FoundBy:
    """Grasps by a detector of pose sets."""

    detector: PoseDetector

    def detect(self, scene: Scene, rng: np.random.Generator) -> PoseSet:
        """Return the accepted grasps, best first."""
        return self.detector.detect(scene, (GRASP,), rng)[GRASP.name]


def with_parameters(
    name: str,
    checkpoint: str,
    load: Callable[[Path], TaskDetector],
    workspace: Callable[[Path | None], Workspace] = usual_workspace,
) -> ClutterDetector:
    """Return a method whose detector is loaded from a file, once a process, on one thread.

    Args:
        name, checkpoint, workspace: as in `ClutterDetector`.
        load: returns the detector with the parameters of a file.
    """

    @lru_cache(maxsize=1)
    def loaded(path: Path) -> FoundBy:
        from split_drake.split.threads import use_one_thread

        use_one_thread()
        return FoundBy(load(path))

    def make(path: Path | None, clearing: Clearing, rng: np.random.Generator) -> FoundBy:
        assert path is not None  # `clutter_detector` has seen to it
        return loaded(path)

    def check(path: Path | None) -> None:
        assert path is not None
        find_tasks((GRASP,), load(path).tasks, str(path))

    return ClutterDetector(name, checkpoint, make, check, workspace)


def ranked(X_WGs: Array, scores: Sequence[float] | Array) -> PoseSet:
    """Return grasps (N, 4, 4) with scores (N,) as a pose set, best first."""
    order = np.argsort(-np.asarray(scores), kind="stable")
    return PoseSet(GRASP, np.asarray(X_WGs)[order], np.asarray(scores, dtype=float)[order])
