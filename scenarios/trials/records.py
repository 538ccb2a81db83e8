"""Trial records: what is kept of a trial, one JSON line each, and the figures drawn from them."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from planning.problem import Stage
from scenarios.trials.limit_log import Peaks, worst
from split_drake.experiments.run import RunFolder
from split_drake.experiments.statistics import Rate

SUCCESS = "success"
ERROR = str(Stage.ERROR)
WIDE_MUG_M = 0.076  # wider bodies do not fit between the fingers


@dataclass(frozen=True)
class TrialRecord:
    """What became of one trial.

    Attributes:
        index: of the trial in its run.
        seed: that the trial's start, noise, detector and planner are drawn from.
        mug: name of the shape.
        mug_diameter_m: of its body.
        outcome: "success", or the stage that failed.
        reason: why, in words; empty on success.
        attempts: one entry for each plan, and for each failure to find one: subgoal, stage and
            reason, what the robot did after it, and how the object was seen to lie in the hand.
        redraws: rejected starts, by reason.
        seconds: wall time by stage.
        simulated_s: time simulated from perception to verdict.
        mesh_sha256: of the mug's mesh file; None for the mugs of the fixed splits.
        peaks: how near the robot came to its limits, see `limit_log.Peaks`.
        memory_bytes: the most that the worker has had resident so far.
        violations: what the independent check found wrong with the trial's plans; None where they
            were not checked.
        recording: path of the recording within the run's folder, if one was kept.
        film: path of an animated picture of a failure within it, if one was kept.
        stills: (path, what it shows) of pictures within it: of failed attempts, and of the end.
        traceback: of the exception that ended the trial, if one did.
    """

    index: int
    seed: int
    mug: str
    mug_diameter_m: float
    outcome: str
    reason: str = ""
    attempts: tuple[dict[str, Any], ...] = ()
    redraws: dict[str, int] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    simulated_s: float = 0.0
    mesh_sha256: str | None = None
    peaks: dict[str, float] = field(default_factory=dict)
    memory_bytes: int = 0
    violations: tuple[str, ...] | None = None
    recording: str | None = None
    film: str | None = None
    stills: tuple[tuple[str, str], ...] = ()
    traceback: str | None = None

    @property
    def succeeded(self) -> bool:
        return self.outcome == SUCCESS

    @property
    def failed_to_run(self) -> bool:
        """Whether an error, a crash or the limit of time ended it: it is tried again."""
        return self.outcome == ERROR

    @property
    def exceeded(self) -> tuple[str, ...]:
        """The limits that the robot went beyond, with the values."""
        return Peaks(**self.peaks).exceeded()

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the record that a line of JSON holds."""
        lists = {key: tuple(value) for key, value in fields.items() if isinstance(value, list)}
        stills = tuple((str(file), str(shown)) for file, shown in fields.get("stills", ()))
        return cls(**{**fields, **lists, "stills": stills})


def trial_run(folder: Path) -> RunFolder[TrialRecord]:
    """Return the folder of a run of trials, whose log is trials.jsonl."""
    return RunFolder(folder, "trials.jsonl", TrialRecord.from_fields)


def success_rate(records: Iterable[TrialRecord]) -> Rate:
    """Return how many of the trials succeeded."""
    return Rate.of(record.succeeded for record in records)


def failures_by_stage(records: Iterable[TrialRecord]) -> dict[str, int]:
    """Return {stage: count} of the failed trials, most frequent first."""
    counts = Counter(record.outcome for record in records if not record.succeeded)
    return dict(counts.most_common())


def median_seconds(records: Sequence[TrialRecord]) -> dict[str, float]:
    """Return {stage: median wall seconds} over the trials that reached the stage."""
    stages = dict.fromkeys(stage for record in records for stage in record.seconds)
    return {
        stage: float(np.median([r.seconds[stage] for r in records if stage in r.seconds]))
        for stage in stages
    }


def total_redraws(records: Iterable[TrialRecord]) -> dict[str, int]:
    """Return {reason: count} of the starts that were drawn again."""
    counts: Counter[str] = Counter()
    for record in records:
        counts.update(record.redraws)
    return dict(counts)


def worst_peaks(records: Iterable[TrialRecord]) -> dict[str, float]:
    """Return the worst peaks of the trials that have any, as records keep them; {} if none has."""
    peaks = worst(Peaks(**record.peaks) for record in records if record.peaks)
    return peaks.rounded() if peaks else {}
