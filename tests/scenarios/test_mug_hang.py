"""The mug-hanging scenario, end to end."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest

from planning.problem import Stage
from scenarios.mug_hang import FREE_KEYS, MugHangOptions, main, run_config, specs_of
from scenarios.trials.records import TrialRecord, trial_run
from scenarios.trials.spec import TrialSpec
from scenarios.trials.trial import crashed_trial, run_trial
from split_drake.experiments.run import AnotherRunError, RunFolder, json_line
from split_drake.objects.mugs.split import mug_names
from split_drake.pose_set import load_pose_sets

ROOT = Path(__file__).parents[2]


def spec_of(folder: Path, **options: object) -> TrialSpec:
    (spec,) = specs_of(MugHangOptions(trials=1, **options), folder, ())  # type: ignore[arg-type]
    return spec


@pytest.mark.parametrize(
    ("detector", "task"), [("oracle", "hang"), ("oracle", "reorient"), ("split", "hang")]
)
def test_one_full_trial(
    detector: Literal["split", "oracle"], task: Literal["hang", "reorient"], tmp_path: Path
) -> None:
    main(
        MugHangOptions(
            trials=1,
            detector=detector,
            task=task,
            check_plans=detector == "oracle",
            workers=1,
            out=tmp_path,
        )
    )
    (record,) = trial_run(tmp_path).records()
    assert record.traceback is None, record.traceback
    if detector == "oracle":
        assert record.succeeded, record.reason
    assert record.violations == (() if detector == "oracle" else None)
    assert any("segments" in attempt for attempt in record.attempts), "no plan was executed"
    assert record.recording is not None
    page = tmp_path / record.recording
    assert 500_000 < page.stat().st_size < 8_000_000
    pose_sets, cloud = load_pose_sets(tmp_path / "poses" / "000-0.npz")
    assert min(len(found) for found in pose_sets.values()) > 0
    assert len(cloud) > 2000
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["trials"], summary["successes"]) == (1, int(record.succeeded))
    assert record.recording in (tmp_path / "index.html").read_text()
    config = json.loads((tmp_path / "config.json").read_text())
    assert (config["checkpoint_sha256"] is None) == (detector == "oracle")


def test_the_number_of_workers_changes_no_outcome(tmp_path: Path) -> None:
    runs = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        main(
            MugHangOptions(
                trials=2,
                seed=2,
                detector="oracle",
                task="reorient",
                workers=workers,
                record="none",
                out=folder,
            )
        )
        runs.append(trial_run(folder).records())
    for one, two in zip(*runs, strict=True):
        assert one.traceback is None
        assert _without_wall_times(one) == _without_wall_times(two)


def _without_wall_times(record: TrialRecord) -> TrialRecord:
    attempts = tuple({**attempt, "planning_s": 0.0} for attempt in record.attempts)
    return replace(record, seconds={}, memory_bytes=0, attempts=attempts)


def test_seeds_choose_the_mug_and_do_not_depend_on_the_run(tmp_path: Path) -> None:
    names = mug_names("test")
    late = specs_of(MugHangOptions(trials=9, seed=3), tmp_path, ())[5]
    (early,) = specs_of(MugHangOptions(trials=1, seed=8), tmp_path, ())
    assert late.seed == early.seed == 8
    assert late.mug_names()[0] == early.mug_names()[0] == names[8]
    assert sorted(late.mug_names()) == sorted(names)


def test_a_trial_that_throws_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> None:
        raise RuntimeError("the solver failed")

    monkeypatch.setattr("scenarios.trials.setup.draw_start", explode)
    record = run_trial(spec_of(tmp_path, detector="oracle", record="none"))
    assert record.outcome == Stage.ERROR
    assert record.reason == "RuntimeError: the solver failed"
    assert "explode" in (record.traceback or "")


def claimed(folder: Path, **options: Any) -> RunFolder[TrialRecord]:
    run = trial_run(folder)
    with run.claim(run_config(MugHangOptions(detector="oracle", **options)), FREE_KEYS):
        return run


def test_a_run_goes_on_after_a_kill(tmp_path: Path) -> None:
    run = claimed(tmp_path, trials=3)
    done = crashed_trial(spec_of(tmp_path, detector="oracle"))
    run.log.write_text(json_line(done) + "\n" + json_line(replace(done, index=1))[:50])
    run = claimed(tmp_path, trials=3)
    assert run.records() == [done]
    run.append(replace(done, index=2))
    assert [record.index for record in claimed(tmp_path, trials=3).records()] == [0, 2]


def test_a_finished_run_is_not_run_again_but_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("split_drake.experiments.pool.WorkerPool._run_until_crash")
    done = crashed_trial(spec_of(tmp_path, detector="oracle"))
    run = claimed(tmp_path, trials=2)
    run.append(done)
    run.append(replace(done, index=1))
    main(MugHangOptions(trials=1, detector="oracle", out=tmp_path))
    assert run.records() == [done, replace(done, index=1)]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["trials"], summary["failures"]) == (1, {Stage.ERROR: 1})


def test_a_folder_of_another_run_is_refused(tmp_path: Path) -> None:
    claimed(tmp_path)
    assert claimed(tmp_path, trials=80, workers=1).records() == []
    with pytest.raises(AnotherRunError, match=r"seed was 0, is 7.*choose another folder"):
        claimed(tmp_path, seed=7)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("trials", 0, "--trials is 0"),
        ("seed", -1, "--seed is -1"),
        ("workers", 0, "--workers is 0"),
        ("noise_m", -0.1, "--noise-m is -0.1"),
        ("planner", "magic", r"'magic'.*default"),
        ("checkpoint", Path("no.safetensors"), "no file no.safetensors"),
    ],
)
def test_bad_options_are_named(option: str, value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MugHangOptions(**{option: value})  # type: ignore[arg-type]


def test_ctrl_c_leaves_a_valid_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scenarios.mug_hang", "--detector", "oracle"]
    command += ["--record", "none", "--workers", "1", "--out", str(tmp_path)]
    log = tmp_path / "trials.jsonl"
    process = subprocess.Popen(command, cwd=ROOT, start_new_session=True)
    while process.poll() is None and not (log.exists() and log.read_text()):
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, the workers too
    assert process.wait() == 0
    records = trial_run(tmp_path).records()
    assert records
    assert all(record.traceback is None for record in records)
    assert "the worker process died" not in [record.reason for record in records]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["trials"] == len(records) < summary["trials_asked_for"]
    assert (tmp_path / "index.html").exists()
