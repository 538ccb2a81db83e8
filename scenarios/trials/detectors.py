"""The detectors that a trial asks."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from planning.subgoal import Subgoal
from scenarios.trials.mug_check import read_grasps
from scenarios.trials.pose_noise import NoisyDetector
from scenarios.trials.setup import Setup
from scenarios.trials.spec import TrialSpec
from split_drake.grasps.sampling import GraspLabels, sample_grasps
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.pose_set import PoseDetector
from split_drake.pose_task import find_tasks
from split_drake.station.cameras.egl import check_rendering
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import read_station
from split_drake.station.layout import Layout
from split_drake.truth.oracle import OracleDetector

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


# A fifth of the simulation's time less than `StationConfig`'s own, and mugs are held as well
# (`scenarios.measuring.physics_study`).
TRIAL_STEP_S = 0.0025


@dataclass(frozen=True)
class Detectors:
    """The detectors of a trial, by when they are asked.

    Attributes:
        usual: of a look that follows no failure.
        again: of one that does, which takes its time.
        again_for_grasps: the same, whose poses spread further.
    """

    usual: PoseDetector
    again: PoseDetector
    again_for_grasps: PoseDetector


def make_detectors(spec: TrialSpec, setup: Setup) -> Detectors:
    """Return the detectors that a trial asks for; the oracle's poses are all there are."""
    if spec.detector == "split":
        split = _split_detector(spec.checkpoint, spec.evaluations)
        return Detectors(split, split.thorough(), split.widened())
    true = OracleDetector(
        setup.truth, setup.mug, _grasp_labels(spec.mugs, setup.mug.name, spec.folder)
    )
    known = NoisyDetector(true, spec.pose_noise) if spec.pose_noise else true
    return Detectors(known, known, known)


def require_working_detector(detector: str, checkpoint: Path | None, task: Subgoal) -> None:
    """Raise BadInputError where no trial could detect: no driver, a wrong checkpoint.

    That is RenderingUnavailableError, CheckpointError, or UnknownTaskError where the checkpoint
    lacks a task that is perceived.
    """
    check_rendering()
    if detector == "split":
        from split_drake.split.checkpoint import default_weights, load_checkpoint

        path = checkpoint or default_weights()
        _, info = load_checkpoint(path)
        find_tasks(task.perceived_tasks, info.tasks, str(path))


def station_of(detector: str, checkpoint: Path | None, file: Path | None = None) -> StationConfig:
    """Return a file's station, or the usual one; its workspace is as large as the detector's.

    Raises BadInputError where the file cannot be used.
    """
    usual = _usual_station(detector, checkpoint)
    return usual if file is None else read_station(file, usual)


def _usual_station(detector: str, checkpoint: Path | None) -> StationConfig:
    """Return a station whose workspace is the one that the detector was trained on."""
    layout = Layout()
    if detector == "split":
        from split_drake.split.checkpoint import default_weights, load_checkpoint

        _, info = load_checkpoint(checkpoint or default_weights())
        layout = Layout(workspace=info.workspace)
    return StationConfig(layout, time_step_s=TRIAL_STEP_S)


@lru_cache(maxsize=1)
def _split_detector(checkpoint: Path | None, evaluations: int) -> "SplitDetector":
    """Return this process's SPLIT."""
    from split_drake.split.detector import SAMPLERS, single_threaded_detector

    return single_threaded_detector(checkpoint, SAMPLERS[evaluations])


@lru_cache(maxsize=64)
def _grasp_labels(mugs: MugSource, name: str, folder: Path) -> GraspLabels:
    """Return the true grasps of a mug, the same in every trial with it."""
    if mugs.folder is not None:
        return read_grasps(folder, name)
    return sample_grasps(mugs.load(name).body, np.random.default_rng(0))
