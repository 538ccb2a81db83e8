"""The mug-hanging scenario, end to end."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from planning.problem import Stage
from scenarios.mug_hang import MugHangOptions, main, open_run, run_config
from scenarios.records import SUCCESS, TrialRecord, read_records
from scenarios.trial_spec import TrialSpec
from scenarios.trials import crashed_trial, run_trial
from split_drake.data.mugs import mug_names

ROOT = Path(__file__).parents[1]


def spec_of(folder: Path, **options: object) -> TrialSpec:
    return TrialSpec.of(MugHangOptions(trials=1, **options), 0, folder)  # type: ignore[arg-type]


@pytest.mark.parametrize("detector", ["oracle", "split"])
def test_one_full_trial(detector: str, tmp_path: Path) -> None:
    main(
        MugHangOptions(trials=1, detector=detector, workers=1, out=tmp_path)  # type: ignore[arg-type]
    )
    (record,) = read_records(tmp_path / "trials.jsonl")
    assert record.outcome in {SUCCESS, *Stage} - {Stage.SIMULATOR_ERROR}, record.traceback
    assert record.attempts
    assert record.seconds["perception"] > 0.0
    assert record.recording is not None
    page = tmp_path / record.recording
    assert 500_000 < page.stat().st_size < 8_000_000
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["trials"] == 1
    assert record.recording in (tmp_path / "index.html").read_text()
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["detector"] == detector
    assert (config["checkpoint_sha256"] is None) == (detector == "oracle")


def test_the_same_seed_gives_the_same_outcome(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, detector="oracle", task="reorient", record="none")
    first, second = run_trial(spec), run_trial(spec)
    assert first.traceback is None
    assert first.outcome == second.outcome
    assert first.simulated_s == second.simulated_s
    assert first.redraws == second.redraws
    assert first.recording is None


def test_seeds_choose_the_mug_and_do_not_depend_on_the_run(tmp_path: Path) -> None:
    names = mug_names("test")
    late = TrialSpec.of(MugHangOptions(trials=9, seed=3), 5, tmp_path)
    early = TrialSpec.of(MugHangOptions(trials=1, seed=8, workers=1), 0, tmp_path)
    assert late.seed == early.seed == 8
    assert late.mug_names()[0] == early.mug_names()[0] == names[8]
    assert sorted(late.mug_names()) == sorted(names)


def test_a_trial_that_throws_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> None:
        raise RuntimeError("the solver failed")

    monkeypatch.setattr("scenarios.trial_setup.draw_start", explode)
    record = run_trial(spec_of(tmp_path, detector="oracle", record="none"))
    assert record.outcome == Stage.SIMULATOR_ERROR
    assert record.reason == "RuntimeError: the solver failed"
    assert "explode" in (record.traceback or "")


def test_a_finished_run_is_not_run_again_but_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("scenarios.mug_hang.run_missing")
    options = MugHangOptions(trials=1, detector="oracle", out=tmp_path)
    open_run(tmp_path, run_config(options))
    done = crashed_trial(spec_of(tmp_path, detector="oracle"))
    (tmp_path / "trials.jsonl").write_text(done.to_json() + "\n")
    main(options)
    assert read_records(tmp_path / "trials.jsonl") == [done]
    failures = json.loads((tmp_path / "summary.json").read_text())["failures"]
    assert failures == {Stage.SIMULATOR_ERROR: 1}


def test_a_folder_of_another_run_is_refused(tmp_path: Path) -> None:
    open_run(tmp_path, run_config(MugHangOptions(detector="oracle")))
    more = MugHangOptions(detector="oracle", trials=80, workers=1)
    assert open_run(tmp_path, run_config(more)) == []
    with pytest.raises(ValueError, match=r"seed was 0, is 7.*choose an --out"):
        open_run(tmp_path, run_config(MugHangOptions(detector="oracle", seed=7)))


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
    process = subprocess.Popen(command, cwd=ROOT, start_new_session=True)
    deadline = time.monotonic() + 120.0
    while not (tmp_path / "config.json").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    time.sleep(5.0)
    process.send_signal(signal.SIGINT)
    assert process.wait(120.0) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    records: list[TrialRecord] = read_records(tmp_path / "trials.jsonl")
    assert summary["trials"] == len(records)
    assert (tmp_path / "index.html").exists()
