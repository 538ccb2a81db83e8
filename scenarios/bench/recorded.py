"""What became of a start that a problem was to be recorded of, as a file of its own."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from planning.problem import PlanningProblem
from planning.problem_files import load_problems, save_problems
from split_drake.files import read_npz, replacing

# What such a file has in place of a problem.
_LEFT_OUT = "left_out"


@dataclass(frozen=True)
class Recorded:
    """What became of one start: a problem, or why there is none.

    Attributes:
        index: of the start.
        name: of the problem.
        problem: compact; None where there is none.
        reason: why; empty where there is one.
        crashed: whether there may be one at another try.
    """

    index: int
    name: str
    problem: PlanningProblem | None
    reason: str = ""
    crashed: bool = False


def save_recorded(path: Path, recorded: Recorded) -> None:
    """Write what became of a start, atomically: its problem, or why it has none."""
    if recorded.problem is not None:
        save_problems(path, {recorded.name: recorded.problem})
        return
    with replacing(path) as temporary:
        np.savez(
            temporary,
            allow_pickle=False,
            **{_LEFT_OUT: np.array(recorded.reason), "name": np.array(recorded.name)},
        )


def load_recorded(path: Path, index: int) -> Recorded:
    """Return what became of start `index`, as written by `save_recorded`."""
    arrays = read_npz(path, "what became of a start")
    if _LEFT_OUT in arrays:
        return Recorded(index, str(arrays["name"]), None, str(arrays[_LEFT_OUT]))
    ((name, problem),) = load_problems(path).items()
    return Recorded(index, name, problem)
