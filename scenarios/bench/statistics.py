"""Figures of planners on the same problems: each alone, and in pairs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np
from scipy.stats import wilcoxon

from scenarios.bench.plan_measures import PlanMeasures
from scenarios.bench.records import BenchRecord
from split_drake.experiments.statistics import Rate, mcnemar_exact

# Of the plans, what planners are compared by.
MEASURES = tuple(field.name for field in fields(PlanMeasures))


@dataclass(frozen=True)
class PlannerSummary:
    """One planner's figures.

    Attributes:
        solved: problems with a plan that the independent checker accepts.
        groups: {group: the same of its problems}, a group being those of one subgoal whose names
            differ only in the number after the last hyphen.  Within a group no two problems share
            a scene, as those of several groups may: the interval is a group's own, for the mugs in
            it.
        timed: problems whose planning time is known, solved or not: all but those that crashed.
        median_s, p95_s: wall time of planning over these; None where there are none.
        median_cpu_s: processor time.
        medians: {measure: median over the solved problems}; empty where none is solved.
        failures: {outcome: count}, most frequent first.
    """

    solved: Rate
    groups: Mapping[str, Rate]
    timed: int
    median_s: float | None
    p95_s: float | None
    median_cpu_s: float | None
    medians: Mapping[str, float]
    failures: Mapping[str, int]

    @classmethod
    def of(cls, records: Sequence[BenchRecord]) -> "PlannerSummary":
        """Return the figures of one planner's records, of which there is at least one."""
        times = [r.planning_s for r in records if r.planning_s is not None]
        cpu = [r.planning_cpu_s for r in records if r.planning_cpu_s is not None]
        plans = [record.measures for record in records if record.measures is not None]
        failures = Counter(record.outcome for record in records if not record.solved)
        return cls(
            solved=_solved(records),
            groups=_by_group(records),
            timed=len(times),
            median_s=_percentile(times, 50.0),
            p95_s=_percentile(times, 95.0),
            median_cpu_s=_percentile(cpu, 50.0),
            medians={name: float(np.median([getattr(p, name) for p in plans])) for name in MEASURES}
            if plans
            else {},
            failures=dict(failures.most_common()),
        )


def _percentile(values: Sequence[float], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values else None


def _solved(records: Sequence[BenchRecord]) -> Rate:
    return Rate.of(record.solved for record in records)


def _by_group(records: Sequence[BenchRecord]) -> dict[str, Rate]:
    found: dict[str, list[BenchRecord]] = {}
    for record in records:
        found.setdefault(_group(record), []).append(record)
    return {group: _solved(own) for group, own in found.items()}


def _group(record: BenchRecord) -> str:
    """Return the problem's subgoal and series: its name without the number.

    The subgoal is that of the problem, whatever its name says; names that begin with it do not
    have it twice.
    """
    stem, _, number = record.problem.rpartition("-")
    series = stem if number.isdigit() else "unnumbered"
    named = not record.subgoal or f"{series}-".startswith(f"{record.subgoal}-")
    return series if named else f"{record.subgoal}-{series}"


@dataclass(frozen=True)
class PairedDifference:
    """How a figure of one planner differs from another's on the same problems.

    Attributes:
        problems: how many have the figure from both.
        median: of the differences, one planner's minus the other's; NaN without problems.
        p: of Wilcoxon's signed-rank test that they are symmetric about 0; 1 where none differs.
    """

    problems: int
    median: float
    p: float

    @classmethod
    def of(cls, ones: Sequence[float], others: Sequence[float]) -> "PairedDifference":
        differences = np.subtract(ones, others)
        if not len(differences):
            return cls(0, float("nan"), 1.0)
        p = float(wilcoxon(differences).pvalue) if differences.any() else 1.0
        return cls(len(differences), float(np.median(differences)), p)


@dataclass(frozen=True)
class Comparison:
    """Two planners on the problems that both were given.

    The tests take problems for independent, and are not corrected for the number of pairs.

    Attributes:
        one, other: their names.
        problems: how many both were given.
        both, only_one, only_other: problems that both, or only one of them, solved.
        mcnemar_p: of McNemar's exact test that both solve the same share.
        cpu_s: difference of processor times, on all shared problems whose times are known.
        measures: {measure: difference}, on problems that both solved.
    """

    one: str
    other: str
    problems: int
    both: int
    only_one: int
    only_other: int
    mcnemar_p: float
    cpu_s: PairedDifference
    measures: Mapping[str, PairedDifference]


def compare_all(records: Sequence[BenchRecord], planners: Sequence[str]) -> list[Comparison]:
    """Return how each pair of planners compares on the problems that all of them were given.

    All pairs thus rest on the same problems, also after an interrupt; no pairs without such ones.
    """
    given = [{record.problem for record in records if record.planner == p} for p in planners]
    shared = set.intersection(*given)
    common = [record for record in records if record.problem in shared]
    return [compare(common, *pair) for pair in combinations(planners, 2)] if shared else []


def compare(records: Sequence[BenchRecord], one: str, other: str) -> Comparison:
    """Return how two planners compare on the problems that both were given."""
    found = by_planner(records)
    ones = {record.problem: record for record in found.get(one, ())}
    others = {record.problem: record for record in found.get(other, ())}
    pairs = [(ones[name], others[name]) for name in ones if name in others]
    only_one = sum(a.solved and not b.solved for a, b in pairs)
    only_other = sum(b.solved and not a.solved for a, b in pairs)
    return Comparison(
        one=one,
        other=other,
        problems=len(pairs),
        both=sum(a.solved and b.solved for a, b in pairs),
        only_one=only_one,
        only_other=only_other,
        mcnemar_p=mcnemar_exact(only_one, only_other),
        cpu_s=_paired([(a.planning_cpu_s, b.planning_cpu_s) for a, b in pairs]),
        measures={
            name: _paired([(_measured(a, name), _measured(b, name)) for a, b in pairs])
            for name in MEASURES
        },
    )


def _measured(record: BenchRecord, name: str) -> float | None:
    return None if record.measures is None else float(getattr(record.measures, name))


def _paired(pairs: Sequence[tuple[float | None, float | None]]) -> PairedDifference:
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    return PairedDifference.of([a for a, _ in known], [b for _, b in known])


def by_planner(records: Sequence[BenchRecord]) -> dict[str, list[BenchRecord]]:
    """Return {planner: its records}, in order of first appearance."""
    found: dict[str, list[BenchRecord]] = {}
    for record in records:
        found.setdefault(record.planner, []).append(record)
    return found
