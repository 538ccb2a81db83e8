"""Calls that are timed in turns, so that whatever else the machine does meets all of them."""

from collections.abc import Callable, Mapping
from statistics import median
from time import perf_counter

# The first rounds warm up and do not count.
WARM_UP = 2


def medians_in_turns(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the median seconds of each call over some rounds, in which each has its turn."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(WARM_UP + rounds):
        for name, call in calls.items():
            began = perf_counter()
            call()
            times[name].append(perf_counter() - began)
    return {name: median(taken[WARM_UP:]) for name, taken in times.items()}
