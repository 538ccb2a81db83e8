"""What trials by one worker and by two come to, beside what the project promises."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.trials.records import TrialRecord
from split_drake.bad_input import BadInputError

GIB = 2.0**30


@dataclass(frozen=True)
class Figure:
    """One measured number and its bound.

    Attributes:
        name: what is measured, with its unit.
        value: measured.
        bound: promised.
        at_most: whether the bound is an upper one.
    """

    name: str
    value: float
    bound: float
    at_most: bool

    @property
    def met(self) -> bool:
        return self.value <= self.bound if self.at_most else self.value >= self.bound


def figures(
    alone: Sequence[TrialRecord], alone_wall_s: float, both: Sequence[TrialRecord], wall_s: float
) -> list[Figure]:
    """Return the figures of the same trials run by one worker (`alone`) and by two (`both`).

    Raises BadInputError where they are not the same trials, or none was planned.
    """
    if [record.index for record in alone] != [record.index for record in both]:
        raise BadInputError(
            f"{len(alone)} trials by one worker and {len(both)} by two; expected the same trials"
        )
    planned = [record for record in alone if "planning" in record.seconds]
    if not planned:
        raise BadInputError(
            f"none of {len(alone)} trials came as far as planning; nothing is timed"
        )
    executed_s = sum(r.seconds["execution"] + r.seconds["verdict"] for r in planned)
    simulated_s = sum(record.simulated_s for record in planned)
    planning_s = float(np.median([record.seconds["planning"] for record in planned]))
    memory = max(record.memory_bytes for record in both) / GIB
    return [
        Figure("planning, median s a trial", planning_s, 1.0, True),
        Figure("simulated s a second, one core", simulated_s / executed_s, 3.0, False),
        Figure("minutes for 40 trials, two workers", wall_s / 60.0 * 40.0 / len(both), 6.0, True),
        Figure("GiB a worker, at most", memory, 1.5, True),
        Figure("two workers, times as fast as one", alone_wall_s / wall_s, 1.8, False),
    ]
