"""The same trials by two commits, in turns."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from split_drake.bad_input import BadInputError
from split_drake.experiments.run import read_json_lines
from split_drake.experiments.statistics import mcnemar_exact

ROOT = Path(__file__).parents[2]
# Trials of one turn: starting a process and loading the network takes as long as one trial.
TURN = 4
_DRAWS = 10_000


@dataclass(frozen=True)
class TimedTrial:
    """One trial of a commit.

    Attributes:
        seconds: of planning and execution.
        succeeded: whether it reached its goal.
    """

    seconds: float
    succeeded: bool


@dataclass(frozen=True)
class CommitComparison:
    """Trials of two commits, by their seeds.

    Attributes:
        ours, theirs: {seed: trial}; seeds of trials that both planned.
    """

    ours: Mapping[int, TimedTrial]
    theirs: Mapping[int, TimedTrial]

    @property
    def ratio(self) -> float:
        """Our time over theirs, of all trials together."""
        ours, theirs = self._seconds()
        return float(ours.sum() / theirs.sum())

    @property
    def ratio_95(self) -> tuple[float, float]:
        """The ratio's bootstrap interval over seeds, 95%."""
        ours, theirs = self._seconds()
        drawn = np.random.default_rng(0).integers(len(ours), size=(_DRAWS, len(ours)))
        low, high = np.quantile(ours[drawn].sum(1) / theirs[drawn].sum(1), (0.025, 0.975))
        return float(low), float(high)

    @property
    def mcnemar_p(self) -> float:
        """Whether outcomes differ."""
        pairs = [(self.ours[seed].succeeded, self.theirs[seed].succeeded) for seed in self.ours]
        return mcnemar_exact(pairs.count((True, False)), pairs.count((False, True)))

    def _seconds(self) -> tuple[np.ndarray, np.ndarray]:
        ours = np.array([each.seconds for each in self.ours.values()])
        return ours, np.array([self.theirs[seed].seconds for seed in self.ours])


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """Give a folder with a commit's files, for as long as it is needed.

    Raises BadInputError where git does not know the commit.
    """
    found = _git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}")
    if found.returncode != 0:
        raise BadInputError(f"--against is {commit!r}; expected a commit of the project's git")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "commit"
        added = _git("worktree", "add", "--detach", str(path), found.stdout.strip())
        if added.returncode != 0:
            raise BadInputError(f"git cannot check out {commit!r}: {added.stderr.strip()}")
        try:
            yield path
        finally:
            _git("worktree", "remove", "--force", str(path))


def _git(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", *command], cwd=ROOT, capture_output=True, text=True, check=False)


def compare_commits(theirs: Path, seeds: Sequence[int], out: Path) -> CommitComparison:
    """Run the same trials by this code and by that of a folder, in turns, on one core each.

    Runs lie in `out`; those that are there already are read.

    Raises BadInputError where one of the two cannot run its trials.
    """
    trees = {"ours": ROOT, "theirs": theirs}
    found: dict[str, dict[int, TimedTrial]] = {name: {} for name in trees}
    for number, first in enumerate(range(0, len(seeds), TURN)):
        turn = seeds[first : first + TURN]
        # Neither always comes first, where a machine may be cooler.
        for name in sorted(trees, reverse=number % 2 == 1):
            found[name] |= _trials(trees[name], turn, out / name / str(turn[0]))
    both = found["ours"].keys() & found["theirs"].keys()
    if not both:
        raise BadInputError("no trial was planned by both commits; nothing is timed")
    ours, others = ({s: found[name][s] for s in sorted(both)} for name in trees)
    return CommitComparison(ours, others)


def _trials(tree: Path, seeds: Sequence[int], out: Path) -> dict[int, TimedTrial]:
    """Return a turn's trials by the code in a folder; those that planned nothing are left out."""
    log = out / "trials.jsonl"
    if len(read_json_lines(log)) < len(seeds):
        command = [sys.executable, "-m", "scenarios.mug_hang", "--workers", "1"]
        command += ["--trials", str(len(seeds)), "--seed", str(seeds[0])]
        command += ["--record", "none", "--out", str(out.absolute())]
        environment = os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            end = done.stderr.strip().splitlines()[-1:] or ["no message"]
            raise BadInputError(f"the trials of {tree} ended with {done.returncode}: {end[0]}")
    return {
        record["seed"]: TimedTrial(
            record["seconds"]["planning"] + record["seconds"].get("execution", 0.0),
            record["outcome"] == "success",
        )
        for record in read_json_lines(log)
        if "planning" in record["seconds"]
    }
