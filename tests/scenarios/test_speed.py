"""The figures of the speed command, from records whose times are known."""

import json
from contextlib import nullcontext
from pathlib import Path

import pytest

from scenarios import mug_hang
from scenarios.speed import SpeedOptions, main, timed_run
from scenarios.timing.commits import CheckedOut, CommitComparison, TimedTrial
from scenarios.timing.detection_speed import MUG_GRASPS, VGN, DetectionSpeed
from scenarios.timing.workers import GIB, figures
from scenarios.trials.records import TrialRecord
from split_drake.experiments.run import json_line
from split_drake.files import write_json


def record(index: int, planning_s: float = 0.9, memory_gib: float = 0.5) -> TrialRecord:
    return TrialRecord(
        index=index,
        seed=index,
        mug="test_000",
        mug_diameter_m=0.07,
        outcome="success",
        seconds={"planning": planning_s, "execution": 1.5, "verdict": 0.5},
        simulated_s=8.0,
        memory_bytes=round(memory_gib * GIB),
    )


def test_figures_are_those_of_the_records() -> None:
    alone = [record(i, planning_s, 0.4) for i, planning_s in enumerate((0.5, 0.9, 2.5))]
    both = [record(i, 0.9, memory_gib) for i, memory_gib in enumerate((0.5, 1.75, 0.5))]
    found = {figure.name.split(",")[0]: figure for figure in figures(alone, 45.0, both, 22.5)}
    assert {name: figure.value for name, figure in found.items()} == {
        "planning": 0.9,
        "simulated s a second": 4.0,
        "minutes for 40 trials": 5.0,
        "GiB a worker": 1.75,
        "two workers": 2.0,
    }
    assert [name for name, figure in found.items() if not figure.met] == ["GiB a worker"]


@pytest.mark.parametrize(
    ("held", "match", "begun"),
    [
        ({1: 2, 2: 3}, r"1_workers holds 2 of 3 trials: the run was interrupted", [1]),
        ({1: 3, 2: 1}, r"2_workers holds 1 of 3 trials: the run was interrupted", [1, 2]),
        ({1: 4, 2: 3}, r"1_workers holds 4 trials, --trials is 3", [1]),
    ],
)
def test_only_whole_runs_of_the_same_trials_are_compared(
    held: dict[int, int],
    match: str,
    begun: list[int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = []

    def run(options: mug_hang.MugHangOptions) -> Path:
        """Leave what a run leaves that has ended after as many trials as `held` says."""
        folder = options.out or tmp_path
        folder.mkdir(parents=True)
        lines = [json_line(record(index)) + "\n" for index in range(held[options.workers])]
        (folder / "trials.jsonl").write_text("".join(lines))
        write_json(folder / "summary.json", {"wall_s": 30.0, "trials": held[options.workers]})
        runs.append(options.workers)
        return folder

    monkeypatch.setattr(mug_hang, "main", run)
    with pytest.raises(ValueError, match=match):
        main(SpeedOptions(out=tmp_path, detections=0, trials=3))
    assert runs == begun


def test_a_run_that_was_killed_is_not_timed(tmp_path: Path) -> None:
    folder = tmp_path / "1_workers"
    folder.mkdir()
    (folder / "trials.jsonl").write_text(json_line(record(0)) + "\n" + json_line(record(1)) + "\n")
    write_json(folder / "summary.json", {"wall_s": 9.0, "trials": 1})
    with pytest.raises(ValueError, match="holds 2 trials, and the time of 1: the run was killed"):
        timed_run(SpeedOptions(out=tmp_path, trials=3), workers=1)


def test_different_trials_are_not_compared() -> None:
    with pytest.raises(ValueError, match="3 trials by one worker and 2 by two"):
        figures([record(i) for i in range(3)], 30.0, [record(i) for i in range(2)], 15.0)


def test_trials_that_never_planned_are_no_measure() -> None:
    failed = TrialRecord(0, 0, "test_000", 0.07, "error")
    with pytest.raises(ValueError, match="none of 1 trials came as far as planning"):
        figures([failed], 1.0, [failed], 1.0)


def test_commits_are_compared_by_trials_of_split(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--trials is 0; expected 1 at least"):
        SpeedOptions(out=tmp_path, trials=0, against="HEAD")
    with pytest.raises(ValueError, match="--detector is 'oracle'; leave it out"):
        SpeedOptions(out=tmp_path, detector="oracle", against="HEAD")


def test_what_was_timed_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    timed = [DetectionSpeed(threads, {VGN: 0.2, MUG_GRASPS: 0.1}) for threads in (1, 2)]
    monkeypatch.setattr("scenarios.speed.detection_speeds", lambda *_: timed)
    trial = {0: TimedTrial(1.0, succeeded=True)}
    compared = CommitComparison(trial, {0: TimedTrial(2.0, succeeded=True)})
    monkeypatch.setattr("scenarios.speed.compare_commits", lambda *_: compared)
    there = nullcontext(CheckedOut("abc", tmp_path))
    monkeypatch.setattr("scenarios.speed.checked_out", lambda _: there)
    out = tmp_path / "speed"
    main(SpeedOptions(out=out, trials=0))
    main(SpeedOptions(out=out, detections=0, against="HEAD"))
    kept = json.loads((out / "speed.json").read_text())
    assert kept["detections"]["1"][MUG_GRASPS] == 0.1
    assert kept["against abc"]["ratio"] == 0.5


def test_records_that_arrived_in_another_order_are_of_the_same_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(options: mug_hang.MugHangOptions) -> Path:
        assert options.out is not None
        options.out.mkdir(parents=True)
        order = range(3) if options.workers == 1 else (1, 0, 2)
        lines = [json_line(record(index)) + "\n" for index in order]
        (options.out / "trials.jsonl").write_text("".join(lines))
        write_json(options.out / "summary.json", {"wall_s": 30.0 / options.workers, "trials": 3})
        return options.out

    monkeypatch.setattr(mug_hang, "main", run)
    main(SpeedOptions(out=tmp_path, detections=0, trials=3))
    kept = json.loads((tmp_path / "speed.json").read_text())["trials"]
    assert kept["two workers, times as fast as one"] == 2.0
