"""Setting a trial up: a mug at rest at a station, and what looks at it and plans."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from planning.planner import Planner, make_planner
from planning.problem import Subgoal
from scenarios.mug_check import read_grasps
from scenarios.mug_source import MugSource
from scenarios.pose_noise import NoisyDetector
from scenarios.recording import FRAMES_PER_SECOND, TrialRecorder
from scenarios.trial_spec import TrialSpec
from split_drake.data.grasps import GraspLabels, sample_grasps
from split_drake.objects import MugShape
from split_drake.oracle import OracleDetector, Truth
from split_drake.pose_set import PoseDetector
from split_drake.starts import NoStartError, draw_start, reject_for_hang, reject_for_reorient
from split_drake.station import Station

if TYPE_CHECKING:  # PyTorch is imported by those who need it
    from split_drake.split.detector import SplitDetector


@dataclass(frozen=True)
class Setup:
    """A mug that lies on the table.

    Attributes:
        mug: its shape.
        station: with the mug as its only object.
        truth: of the station.
        redraws: rejected starts, by reason.
        recorder: that the station publishes to, where one is wanted.
    """

    mug: MugShape
    station: Station
    truth: Truth
    redraws: Counter[str]
    recorder: TrialRecorder | None


@dataclass(frozen=True)
class TrialGenerators:
    """What a trial draws from: one generator for each of its parts.

    So the same seed gives every detector and planner the same scene.
    """

    start: np.random.Generator
    noise: np.random.Generator
    detector: np.random.Generator
    planner: np.random.Generator

    @classmethod
    def of(cls, seed: int) -> Self:
        return cls(*(np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)))


def set_up(spec: TrialSpec, rng: np.random.Generator) -> Setup:
    """Draw a trial's start.

    A mug that will not lie as the task needs it (a wide cup rights itself) is passed over for the
    next one of its split.

    Raises NoStartError where none of them will.
    """
    redraws: Counter[str] = Counter()
    reject = reject_for_hang if spec.task is Subgoal.HANG else reject_for_reorient
    for name in spec.mug_names():
        recorder = None if spec.record == "none" else TrialRecorder()
        mug = spec.load_mug(name)
        station = Station(
            replace(spec.station, meshcat_rate_hz=FRAMES_PER_SECOND),
            [mug.body],
            meshcat=recorder.meshcat if recorder else None,
        )
        truth = Truth(station)
        try:
            start = draw_start(station, truth, rng, reject)
        except NoStartError as error:
            redraws.update((*error.redraws, f"passed over {name}"))
            continue
        redraws.update(start.redraws)
        return Setup(mug, station, truth, redraws, recorder)
    raise NoStartError(f"all mugs of {spec.mugs.where}", list(redraws.elements()))


def make_detector(spec: TrialSpec, setup: Setup, wide: bool = False) -> PoseDetector:
    """Return the detector that a trial asks for; `wide`: one of poses that spread further.

    The true poses are all there are.
    """
    if spec.detector == "split":
        detector = _split_detector(spec.checkpoint)
        return detector.widened() if wide else detector
    oracle = OracleDetector(
        setup.truth, setup.mug, _grasp_labels(spec.mugs, setup.mug.body.name, spec.folder)
    )
    return NoisyDetector(oracle, spec.pose_noise) if spec.pose_noise else oracle


@lru_cache(maxsize=1)
def planner_named(name: str) -> Planner:
    """Return this process's planner of that name; it keeps its collision world."""
    return make_planner(name)


@lru_cache(maxsize=1)
def _split_detector(checkpoint: Path | None) -> "SplitDetector":
    """Return SPLIT, on one thread: results depend on the number of threads."""
    import torch

    from split_drake.split.detector import SplitDetector

    torch.set_num_threads(1)
    return SplitDetector.from_checkpoint(checkpoint)


@lru_cache(maxsize=64)
def _grasp_labels(mugs: MugSource, name: str, folder: Path) -> GraspLabels:
    """Return the true grasps of a mug, the same in every trial with it."""
    if mugs.folder is not None:
        return read_grasps(folder, name)
    return sample_grasps(mugs.load(name), np.random.default_rng(0))
