"""Rates with intervals, and tests of paired outcomes."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

from scipy.stats import binomtest


@dataclass(frozen=True)
class Rate:
    """Successes out of trials with Wilson's 95% interval."""

    successes: int
    trials: int

    @classmethod
    def of(cls, outcomes: Iterable[bool]) -> Self:
        """Return the rate of outcomes that are true."""
        flags = list(outcomes)
        return cls(sum(flags), len(flags))

    @property
    def value(self) -> float:
        """The share of successes; NaN without trials."""
        return self.successes / self.trials if self.trials else float("nan")

    @property
    def wilson95(self) -> tuple[float, float]:
        """Wilson's score interval at 95%; (0, 1) without trials."""
        if not self.trials:
            return (0.0, 1.0)
        interval = binomtest(self.successes, self.trials).proportion_ci(0.95, method="wilson")
        return (float(interval.low), float(interval.high))

    def __str__(self) -> str:
        if not self.trials:
            return "no trials"
        low, high = self.wilson95
        return f"{self.successes}/{self.trials} = {self.value:.1%}  [{low:.0%}, {high:.0%}]"


def mcnemar_exact(only_one: int, only_other: int) -> float:
    """Return the two-sided p of McNemar's exact test; 1 without discordant pairs."""
    discordant = only_one + only_other
    return float(binomtest(only_one, discordant).pvalue) if discordant else 1.0
