"""The detectors that trials ask, by name.

A detector is a file in `scenarios/trials/detectors/` with a constant `DETECTOR`; nothing else has
to know of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

from planning.subgoal import Subgoal
from scenarios.trials.setup import Setup
from scenarios.trials.spec import TrialSpec
from split_drake.bad_input import BadInputError
from split_drake.experiments.room_files import constants_in
from split_drake.pose_set import PoseDetector
from split_drake.scene import Workspace
from split_drake.station.cameras.egl import check_rendering
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import read_station
from split_drake.station.layout import Layout

_ROOM = "scenarios.trials.detectors"
# A fifth of the simulation's time less than `StationConfig`'s own, and mugs are held as well
# (`scenarios.measuring.physics_study`).
TRIAL_STEP_S = 0.0025


@dataclass(frozen=True)
class Detectors:
    """What a trial asks, by when it asks.

    Attributes:
        usual: at a look that follows no failure.
        again: at one that does: it may take its time.
        again_for_grasps: the same, where grasps unlike those that failed are worth most.
    """

    usual: PoseDetector
    again: PoseDetector
    again_for_grasps: PoseDetector

    @classmethod
    def alike(cls, detector: PoseDetector) -> Self:
        """Return one detector, whenever it is asked."""
        return cls(detector, detector, detector)


@dataclass(frozen=True)
class TrialDetector:
    """A detector by name.

    Attributes:
        name: what it is called on the command line.
        make: returns what a trial asks.  Called once a trial: what is expensive should be kept.
        weights: returns the file of its parameters, given `--checkpoint`; None where it has none.
        check: raises BadInputError where it cannot serve a task with that checkpoint; called before
            the first trial.
        workspace: returns the cube that its scenes are cropped to, given that checkpoint.
        knows_truth: whether it gives true poses: `--pose-noise-mm` may be added to them, and true
            grasps of the user's own mugs are worked out before the first trial.
    """

    name: str
    make: Callable[[TrialSpec, Setup], Detectors]
    weights: Callable[[Path | None], Path | None] = lambda checkpoint: None
    check: Callable[[Path | None, Subgoal], None] = lambda checkpoint, task: None
    workspace: Callable[[Path | None], Workspace] = lambda checkpoint: Layout().workspace
    knows_truth: bool = False


@lru_cache(maxsize=1)
def trial_detectors() -> Mapping[str, TrialDetector]:
    """Return all detectors by their names.

    Raises ValueError where a file of the room has none, or two have the same name.
    """
    return constants_in(_ROOM, "DETECTOR", TrialDetector, lambda each: each.name)


def trial_detector(name: str) -> TrialDetector:
    """Return the detector of that name; BadInputError naming the known ones where there is none."""
    known = trial_detectors()
    if name not in known:
        raise BadInputError(
            f"there is no detector {name!r}; expected one of {', '.join(sorted(known))}"
        )
    return known[name]


def require_working_detector(detector: str, checkpoint: Path | None, task: Subgoal) -> None:
    """Raise BadInputError where no trial could detect: no driver, a wrong checkpoint.

    That is RenderingUnavailableError, CheckpointError, or UnknownTaskError where the checkpoint
    lacks a task that is perceived.
    """
    check_rendering()
    trial_detector(detector).check(checkpoint, task)


def station_of(detector: str, checkpoint: Path | None, file: Path | None = None) -> StationConfig:
    """Return a file's station, or the usual one; its workspace is as large as the detector's.

    Raises BadInputError where the file cannot be used.
    """
    workspace = trial_detector(detector).workspace(checkpoint)
    usual = StationConfig(Layout(workspace=workspace), time_step_s=TRIAL_STEP_S)
    return usual if file is None else read_station(file, usual)
