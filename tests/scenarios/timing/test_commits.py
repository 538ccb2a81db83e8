"""The same trials by two commits."""

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from scenarios.timing import commits
from scenarios.timing.commits import (
    ROOT,
    TURN,
    CommitComparison,
    TimedTrial,
    checked_out,
    compare_commits,
)
from scenarios.trials.records import TrialRecord
from split_drake.experiments.run import json_line

Run = Callable[..., subprocess.CompletedProcess[str]]


def comparison(ours: Sequence[float], theirs: Sequence[float]) -> CommitComparison:
    def trials(seconds: Sequence[float]) -> dict[int, TimedTrial]:
        return {seed: TimedTrial(each, each < 9.0) for seed, each in enumerate(seconds)}

    return CommitComparison(trials(ours), trials(theirs))


def test_the_ratio_is_of_all_trials_together() -> None:
    compared = comparison([1.0, 2.0, 3.0], [2.0, 4.0, 6.0])
    assert compared.ratio == compared.ratio_95[0] == compared.ratio_95[1] == 0.5
    low, high = comparison([1.0, 1.0, 4.0], [2.0, 2.0, 2.0]).ratio_95
    assert low == 0.5 and high == 2.0


def test_outcomes_are_compared_trial_by_trial() -> None:
    assert comparison([1.0] * 6, [1.0] * 6).mcnemar_p == 1.0
    assert comparison([9.0] * 6, [1.0] * 6).mcnemar_p == pytest.approx(0.03125)


class FakeRuns:
    """Writes records in place of running trials, and keeps who ran what."""

    def __init__(self, seconds: dict[Path, float], fails: Path | None = None) -> None:
        self.seconds, self.fails = seconds, fails
        self.ran: list[tuple[Path, int, int]] = []

    def __call__(
        self, command: list[str], cwd: Path, env: dict[str, str], **_: Any
    ) -> subprocess.CompletedProcess[str]:
        assert env["PYTHONPATH"] == str(cwd) and env["OMP_NUM_THREADS"] == "1"
        if cwd == self.fails:
            return subprocess.CompletedProcess(command, 2, "", "first\nit has no such option\n")
        given = dict(zip(command[3::2], command[4::2], strict=True))
        seed, count, out = int(given["--seed"]), int(given["--trials"]), Path(given["--out"])
        out.mkdir(parents=True)
        lines = []
        for each in range(seed, seed + count):
            planned = each != 1
            took = {"start": 1.0, "planning": 0.5, "execution": self.seconds[cwd] - 0.5}
            seconds = took if planned else {"start": 1.0}
            outcome = "success" if planned else "perception"
            record = TrialRecord(each - seed, each, "test_000", 0.07, outcome, seconds=seconds)
            lines.append(json_line(record) + "\n")
        (out / "trials.jsonl").write_text("".join(lines))
        self.ran.append((cwd, seed, count))
        return subprocess.CompletedProcess(command, 0, "", "")


def test_both_commits_run_the_same_trials_in_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs = tmp_path / "theirs"
    runs = FakeRuns({ROOT: 2.0, theirs: 4.0})
    monkeypatch.setattr(commits.subprocess, "run", runs)
    found = compare_commits(theirs, range(TURN + 2), tmp_path)
    first, second = (0, TURN), (TURN, 2)
    assert runs.ran == [(ROOT, *first), (theirs, *first), (theirs, *second), (ROOT, *second)]
    assert found.ratio == 0.5
    assert list(found.ours) == list(found.theirs) == list(range(TURN + 2))
    assert found.timed == [0, *range(2, TURN + 2)]
    assert not found.ours[1].succeeded and found.ours[1].seconds is None
    assert found.figures()["trials"] == TURN + 2 == found.figures()["timed"] + 1
    fewer = compare_commits(theirs, [0, 2], tmp_path)
    assert list(fewer.ours) == [0, 2] and len(runs.ran) == 4
    again = compare_commits(theirs, range(TURN + 2), tmp_path)
    assert again == found and len(runs.ran) == 4


def test_a_commit_that_cannot_run_its_trials_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs = tmp_path / "theirs"
    monkeypatch.setattr(commits.subprocess, "run", FakeRuns({ROOT: 2.0}, fails=theirs))
    with pytest.raises(ValueError, match="theirs ended with 2: it has no such option"):
        compare_commits(theirs, range(2), tmp_path)


def test_where_nothing_was_planned_nothing_is_timed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs = tmp_path / "theirs"
    monkeypatch.setattr(commits.subprocess, "run", FakeRuns({ROOT: 2.0, theirs: 2.0}))
    with pytest.raises(ValueError, match="no trial was executed by both"):
        compare_commits(theirs, [1], tmp_path)


def test_a_commit_is_checked_out_while_it_is_needed() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("the sources lie in no git repository")
    with checked_out("HEAD") as (commit, folder):
        assert (folder / "scenarios" / "mug_hang.py").is_file()
        assert len(commit) == 40
    assert not folder.exists()


def test_without_git_no_commit_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    told = pytest.raises(ValueError, match="--against needs git, which does not run")
    with told, checked_out("HEAD"):
        pass


def test_a_commit_that_git_does_not_know_is_told() -> None:
    known = pytest.raises(ValueError, match="--against is 'no-such'; expected a commit")
    with known, checked_out("no-such"):
        pass
