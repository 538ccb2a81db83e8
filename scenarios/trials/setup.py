"""Setting a trial up: a mug at rest at a station, and what looks at it and plans."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np

from planning.planner import Planner, make_planner
from scenarios.trials.mug_tasks import mug_task
from scenarios.trials.spec import TrialSpec
from scenarios.viewing.recording import FRAMES_PER_SECOND, Recorder
from split_drake.objects.mug_shape import MugShape
from split_drake.station.station import Station
from split_drake.truth.starts import NoStartError, draw_start
from split_drake.truth.state import Truth

# Counted among the redraws, though it is no start.
_PASSED_OVER = "passed over"


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
    recorder: Recorder | None


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
    reject = mug_task(spec.task).reject
    for name in spec.mug_names():
        recorder = None if spec.record == "none" else Recorder()
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
            redraws.update((*error.redraws, f"{_PASSED_OVER} {name}"))
            continue
        redraws.update(start.redraws)
        return Setup(mug, station, truth, redraws, recorder)
    starts = [reason for reason in redraws.elements() if not reason.startswith(_PASSED_OVER)]
    raise NoStartError(f"all mugs of {spec.mugs.where}", starts)


@lru_cache(maxsize=1)
def planner_named(name: str) -> Planner:
    """Return this process's planner of that name; it keeps its collision world."""
    return make_planner(name)
