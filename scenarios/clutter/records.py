"""What became of rounds of clutter removal, grasp by grasp, and what they come to."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from split_drake.experiments.pool import WORKER_DIED
from split_drake.experiments.run import RunFolder

# How a round may end: see `rounds`.
EMPTIED = "no object is left"
NO_GRASP = "no grasp was found"
NO_PLAN = "no grasp that was found can be planned"
TWO_FAILURES = "two grasps in a row failed"
LOST_ARM = "the arm found no way home"
BROKEN = "the simulation failed"
CRASHED = WORKER_DIED
TOO_LONG = "it took too long"
ERROR = "an error"

BOOTSTRAP_DRAWS = 10_000


@dataclass(frozen=True)
class GraspRecord:
    """A grasp that was tried.

    Attributes:
        X_WG: 4 rows of the pose in W.
        score: that it was chosen by.
        candidates: how many grasps there were.
        taken, lost: names of the objects that were removed with the hand, and that left the cube.
        stopped_by: bodies that the hand touched on its way in; an arm, which feels a force, says
            "something".
        reason: why it failed; empty on success.
    """

    X_WG: list[list[float]]
    score: float
    candidates: int
    taken: tuple[str, ...]
    lost: tuple[str, ...]
    stopped_by: tuple[str, ...]
    reason: str

    @property
    def succeeded(self) -> bool:
        return not self.reason


@dataclass(frozen=True)
class RoundRecord:
    """A round of clutter removal.

    Attributes:
        seed, index: of the round: its seed, and its number under that seed.
        objects: names of the objects that it began with.
        grasps: that were tried, in their order.
        ended: why it ended.
        detail: what kept every grasp from being planned, or broke the simulation.
        wall_s: what it took.
        recording: page of it, relative to the run's folder; None where none was kept.
    """

    seed: int
    index: int
    objects: tuple[str, ...]
    grasps: tuple[GraspRecord, ...]
    ended: str
    detail: str = ""
    wall_s: float = 0.0
    recording: str | None = None

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the record that a line of the log holds."""
        grasps = [
            GraspRecord(
                **{**grasp, **{key: tuple(grasp[key]) for key in ("taken", "lost", "stopped_by")}}
            )
            for grasp in fields["grasps"]
        ]
        return cls(**{**fields, "objects": tuple(fields["objects"]), "grasps": tuple(grasps)})

    @property
    def failed_to_run(self) -> bool:
        """Whether an error, a crash or the limit of time ended it: it is tried again."""
        return self.ended in (CRASHED, TOO_LONG, ERROR)

    @property
    def successes(self) -> int:
        """How many of the grasps succeeded."""
        return sum(grasp.succeeded for grasp in self.grasps)

    @property
    def clean(self) -> bool:
        """Whether no grasp failed."""
        return self.successes == len(self.grasps)


def clutter_run(folder: Path) -> RunFolder[RoundRecord]:
    """Return the folder of a run, whose log is rounds.jsonl."""
    return RunFolder(folder, "rounds.jsonl", RoundRecord.from_fields)


@dataclass(frozen=True)
class Share:
    """A share that is pooled over rounds.

    Attributes:
        value: the share; NaN of nothing.
        interval: 95%, by drawing rounds with replacement: grasps of one round hang together.
        seeds: the share of each seed's rounds.
    """

    value: float
    interval: tuple[float, float]
    seeds: tuple[float, ...] = field(default=())

    @classmethod
    def of(cls, parts: Sequence[tuple[int, int]], wholes: Sequence[int]) -> Self:
        """Return the share of rounds.

        Args:
            parts: (seed, count) of each round.
            wholes: of each round, what the count is of.
        """
        seeds, counts = np.array(parts).reshape(-1, 2).T
        of = np.array(wholes, dtype=int)
        rng = np.random.default_rng(0)
        drawn = rng.integers(len(of), size=(BOOTSTRAP_DRAWS, len(of)))
        draws = _ratio(counts[drawn].sum(axis=1), of[drawn].sum(axis=1))
        low, high = np.nanpercentile(draws, (2.5, 97.5)) if np.isfinite(draws).any() else (0.0, 1.0)
        each = [
            float(_ratio(counts[seeds == seed].sum(), of[seeds == seed].sum()))
            for seed in np.unique(seeds)
        ]
        return cls(float(_ratio(counts.sum(), of.sum())), (float(low), float(high)), tuple(each))

    def __str__(self) -> str:
        if np.isnan(self.value):
            return "none"
        low, high = self.interval
        text = f"{self.value:.1%}  [{low:.0%}, {high:.0%}]"
        if len(self.seeds) < 2:
            return text
        return f"{text}  {np.mean(self.seeds):.1%} ± {np.std(self.seeds, ddof=1):.1%} over seeds"


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(part / np.asarray(whole, dtype=float))


@dataclass(frozen=True)
class Removal:
    """What rounds come to.

    Attributes:
        rounds, attempts, successes, objects: counts.
        gsr: the grasp success rate, successes of attempts.
        dr: the declutter rate, successes of objects at the start.
        ended: {why: rounds}.
        failures: {reason without its numbers: grasps}.
    """

    rounds: int
    attempts: int
    successes: int
    objects: int
    gsr: Share
    dr: Share
    ended: dict[str, int]
    failures: dict[str, int]

    @classmethod
    def of(cls, records: Sequence[RoundRecord]) -> Self:
        """Return what records come to; there must be one at least."""
        if not records:
            raise ValueError("no rounds were given; expected at least one")
        parts = [(record.seed, record.successes) for record in records]
        attempts = [len(record.grasps) for record in records]
        objects = [len(record.objects) for record in records]
        faults = [g.reason for record in records for g in record.grasps if not g.succeeded]
        return cls(
            rounds=len(records),
            attempts=sum(attempts),
            successes=sum(count for _, count in parts),
            objects=sum(objects),
            gsr=Share.of(parts, attempts),
            dr=Share.of(parts, objects),
            ended=dict(Counter(record.ended for record in records).most_common()),
            failures=dict(Counter(map(kind_of_failure, faults)).most_common()),
        )

    def to_json(self) -> dict[str, Any]:
        """Return the figures for summary.json."""
        return {
            "rounds": self.rounds,
            "attempts": self.attempts,
            "successes": self.successes,
            "objects": self.objects,
            "gsr": _number(self.gsr.value),
            "gsr_interval": self.gsr.interval,
            "gsr_of_seeds": [_number(value) for value in self.gsr.seeds],
            "dr": _number(self.dr.value),
            "dr_interval": self.dr.interval,
            "dr_of_seeds": [_number(value) for value in self.dr.seeds],
            "ended": self.ended,
            "failures": self.failures,
        }


def _number(value: float) -> float | None:
    """Return a share as JSON has it: null where it is of nothing."""
    return None if np.isnan(value) else value


def kind_of_failure(reason: str) -> str:
    """Return a reason without distances and without the names of bodies."""
    if reason.startswith("the hand touches"):
        return "the hand touches something before the grasp"
    if "; it was stopped" in reason:
        return f"{kind_of_failure(reason.partition(';')[0])}; it was stopped on its way in"
    if reason.startswith("the pads closed"):
        return "the pads closed on nothing"
    if reason.startswith(("the hand is empty after", "the object slipped during")):
        return reason.partition(":")[0]
    return reason
