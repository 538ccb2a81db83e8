"""Odd inputs by the thousand: `python -m tests.fuzz.fuzz --count 20000`.

Each input either gives a right result or is refused in one sentence.  Input number i of a seed is
always the same: `--first i --count 1` tries it again.
"""

import tempfile
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import track

from split_drake.bad_input import require_count, require_numbers
from split_drake.experiments.command import run_command
from tests.fuzz import targets
from tests.fuzz.model_targets import MODEL_TARGETS

_LONGEST = 1000
TARGETS = (*targets.TARGETS, *MODEL_TARGETS)


@dataclass(frozen=True)
class FuzzOptions:
    """Try odd inputs.

    Attributes:
        count: how many.
        seed: that they are drawn from.
        first: number of the first one.
    """

    count: int = 20000
    seed: int = 0
    first: int = 0

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        require_count("--count", self.count, 1)
        require_count("--first", self.first)


@dataclass(frozen=True)
class Outcome:
    """What became of one input: "used", "refused", or a fault told in words."""

    target: str
    verdict: str
    fault: str = ""


def tried(number: int, seed: int, folder: Path) -> Outcome:
    """Return what became of input `number`."""
    target = TARGETS[number % len(TARGETS)]
    rng = np.random.default_rng([seed, number])
    place = folder / target.name
    place.mkdir(exist_ok=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target.run(place, rng)
    except ValueError as error:
        return _refusal(target.name, error)
    except Exception:
        return Outcome(target.name, "fault", traceback.format_exc())
    return Outcome(target.name, "used")


def _refusal(name: str, error: ValueError) -> Outcome:
    """Return a refusal; a fault where it is no sentence of this project."""
    told = str(error)
    raised_in = traceback.extract_tb(error.__traceback__)[-1].filename
    ours = any(
        f"/{room}/" in raised_in for room in ("split_drake", "planning", "scenarios", "tests")
    )
    if ours and told and "\n" not in told and len(told) <= _LONGEST:
        return Outcome(name, "refused")
    return Outcome(name, "fault", f"told in {raised_in}: {told[:_LONGEST]!r}")


def main(options: FuzzOptions) -> None:
    """Try the inputs; exit with status 1 where one is a fault."""
    counts: Counter[tuple[str, str]] = Counter()
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        for number in track(range(options.first, options.first + options.count), "fuzzing"):
            outcome = tried(number, options.seed, Path(folder))
            counts[outcome.target, outcome.verdict] += 1
            if outcome.fault:
                faults += 1
                print(f"input {number} of {outcome.target}: {outcome.fault}")
    for (target, verdict), count in sorted(counts.items()):
        print(f"{target}: {count} {verdict}")
    print(f"{faults} faults in {options.count} inputs")
    if faults:
        raise SystemExit(1)


if __name__ == "__main__":
    run_command(main, FuzzOptions, __doc__)
