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
from split_drake.objects.procedural.split import ProceduralSource
from split_drake.objects.rigid import RigidObject
from split_drake.station.station import Station
from split_drake.truth.company import stand_beside
from split_drake.truth.starts import NoStartError, draw_start
from split_drake.truth.state import Truth

# Things that stand beside mugs on tables.
OTHER_KINDS = ("box", "bowl", "can", "bottle", "pyramid", "vase", "tower", "car")
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
    sensor: np.random.Generator
    others: np.random.Generator

    @classmethod
    def of(cls, seed: int) -> Self:
        return cls(*(np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(6)))


def set_up(spec: TrialSpec, rngs: TrialGenerators) -> Setup:
    """Draw a trial's start; other things stand beside the mug once that lies.

    A mug that will not lie as the task needs it (a wide cup rights itself) is passed over for the
    next one of its split.

    Raises NoStartError where none of them will.
    """
    redraws: Counter[str] = Counter()
    reject = mug_task(spec.task).reject
    others = other_things(spec.objects, rngs.others)
    for name in spec.mug_names():
        recorder = None if spec.record == "none" else Recorder(title=_title(spec, name))
        mug = spec.load_mug(name)
        station = Station(
            replace(spec.station, meshcat_rate_hz=FRAMES_PER_SECOND),
            [mug.body, *others],
            meshcat=recorder.meshcat if recorder else None,
            sensor_rng=rngs.sensor,
            logged=True,
        )
        truth = Truth(station)
        for index in range(1, len(station.objects)):
            station.park_object(index)
        try:
            start = draw_start(station, truth, rngs.start, reject)
            stand_beside(station, truth, range(1, len(station.objects)), rngs.others)
        except NoStartError as error:
            redraws.update((*error.redraws, f"{_PASSED_OVER} {name}"))
            continue
        redraws.update(start.redraws)
        return Setup(mug, station, truth, redraws, recorder)
    starts = [reason for reason in redraws.elements() if not reason.startswith(_PASSED_OVER)]
    raise NoStartError(f"all mugs of {spec.mugs.where}", starts)


def _title(spec: TrialSpec, mug: str) -> str:
    """Return what a recording is called."""
    return f"trial {spec.index}, {spec.task}, {mug}"


def other_things(count: int, rng: np.random.Generator) -> list[RigidObject]:
    """Return so many objects that are no mugs, of `OTHER_KINDS`."""
    source = ProceduralSource("train")
    names = [name for name in source.names() if name.rpartition("_")[0] in OTHER_KINDS]
    return [
        replace(source.load(str(name)).body, name=f"{name}#{number}")
        for number, name in enumerate(rng.choice(names, count))
    ]


@lru_cache(maxsize=1)
def planner_named(name: str) -> Planner:
    """Return this process's planner of that name; it keeps its collision world."""
    return make_planner(name)
