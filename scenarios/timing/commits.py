"""The same trials by two commits, in turns."""

import io
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from split_drake.bad_input import BadInputError
from split_drake.experiments.run import read_json_lines
from split_drake.experiments.statistics import mcnemar_exact
from split_drake.poses import Array

ROOT = Path(__file__).parents[2]
# Trials of one turn: starting a process and loading the network takes as long as one trial.
TURN = 4
_DRAWS = 10_000


@dataclass(frozen=True)
class TimedTrial:
    """One trial of a commit.

    Attributes:
        seconds: of planning and execution; None where nothing was executed.
        succeeded: whether it reached its goal.
    """

    seconds: float | None
    succeeded: bool


@dataclass(frozen=True)
class CommitComparison:
    """The same trials of two commits.

    Attributes:
        ours, theirs: {seed: trial}.
    """

    ours: Mapping[int, TimedTrial]
    theirs: Mapping[int, TimedTrial]

    @property
    def timed(self) -> list[int]:
        """Seeds of the trials in which both executed something."""
        return [
            seed
            for seed, each in self.ours.items()
            if each.seconds is not None and self.theirs[seed].seconds is not None
        ]

    def seconds(self) -> tuple[Array, Array]:
        """Return our times (N,) and theirs (N,) of those trials."""
        ours, theirs = (
            np.array([trials[seed].seconds for seed in self.timed], dtype=float)
            for trials in (self.ours, self.theirs)
        )
        return ours, theirs

    @property
    def ratio(self) -> float:
        """Our time over theirs, of all timed trials together."""
        ours, theirs = self.seconds()
        return float(ours.sum() / theirs.sum())

    @property
    def ratio_95(self) -> tuple[float, float]:
        """The ratio's bootstrap interval over seeds, 95%."""
        ours, theirs = self.seconds()
        drawn = np.random.default_rng(0).integers(len(ours), size=(_DRAWS, len(ours)))
        low, high = np.quantile(ours[drawn].sum(1) / theirs[drawn].sum(1), (0.025, 0.975))
        return float(low), float(high)

    @property
    def mcnemar_p(self) -> float:
        """Whether outcomes differ."""
        pairs = [(self.ours[seed].succeeded, self.theirs[seed].succeeded) for seed in self.ours]
        return mcnemar_exact(pairs.count((True, False)), pairs.count((False, True)))

    def figures(self) -> dict[str, Any]:
        """Return all that, as JSON has it."""
        return {
            "trials": len(self.ours),
            "timed": len(self.timed),
            "ratio": self.ratio,
            "ratio_95": list(self.ratio_95),
            "successes": [
                sum(each.succeeded for each in trials.values())
                for trials in (self.ours, self.theirs)
            ],
            "mcnemar_p": self.mcnemar_p,
        }


class CheckedOut(NamedTuple):
    """A commit's files: the whole hash, and the folder that they are in."""

    commit: str
    tree: Path


@contextmanager
def checked_out(commit: str) -> Iterator[CheckedOut]:
    """Give a folder with a commit's files, for as long as it is needed.

    Raises BadInputError where git does not know the commit.
    """
    found = _git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}")
    if found.returncode != 0:
        raise BadInputError(f"--against is {commit!r}; expected a commit of the project's git")
    whole = found.stdout.decode().strip()
    with tempfile.TemporaryDirectory() as folder:
        packed = _git("archive", "--format=tar", whole)
        if packed.returncode != 0:
            raise BadInputError(f"git cannot pack {whole}: {packed.stderr.decode().strip()}")
        with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
            archive.extractall(folder, filter="data")
        yield CheckedOut(whole, Path(folder))


def _git(*command: str) -> subprocess.CompletedProcess[bytes]:
    try:
        return subprocess.run(["git", *command], cwd=ROOT, capture_output=True, check=False)
    except OSError as error:
        raise BadInputError(f"--against needs git, which does not run: {error}") from error


def compare_commits(theirs: Path, seeds: Sequence[int], out: Path) -> CommitComparison:
    """Run the same trials by this code and by that of a folder, in turns, on one core each.

    Runs lie in `out`; those that are there already are read.

    Raises BadInputError where one of the two cannot run its trials, or both executed none of them.
    """
    trees = {"ours": ROOT, "theirs": theirs}
    found: dict[str, dict[int, TimedTrial]] = {name: {} for name in trees}
    for number, first in enumerate(range(0, len(seeds), TURN)):
        turn = seeds[first : first + TURN]
        # Neither always comes first, where a machine may be cooler.
        for name in sorted(trees, reverse=number % 2 == 1):
            found[name] |= _trials(trees[name], turn, out / name / str(turn[0]))
    compared = CommitComparison(found["ours"], found["theirs"])
    if not compared.timed:
        raise BadInputError("no trial was executed by both commits; nothing is timed")
    return compared


def _trials(tree: Path, seeds: Sequence[int], out: Path) -> dict[int, TimedTrial]:
    """Return a turn's trials by the code in a folder."""
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
        record["seed"]: TimedTrial(_seconds(record["seconds"]), record["outcome"] == "success")
        for record in read_json_lines(log)
        if record["seed"] in seeds
    }


def _seconds(seconds: Mapping[str, float]) -> float | None:
    if "execution" not in seconds:
        return None
    return seconds["planning"] + seconds["execution"]
