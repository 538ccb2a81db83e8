"""The mug-hanging scenario, end to end."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from planning.planner import make_planner
from planning.problem import Plan, PlanFailure, PlanningProblem, SegmentName, Stage
from scenarios.mug_hang import FREE_KEYS, MugHangOptions, main, run_config, specs_of
from scenarios.trials.records import SUCCESS, TrialRecord, trial_run
from scenarios.trials.spec import TrialSpec
from scenarios.trials.trial import crashed_trial, run_trial
from split_drake.bad_input import BadInputError
from split_drake.experiments.run import AnotherRunError, NoResultsError, RunFolder, json_line
from split_drake.objects.mugs.split import mug_names
from split_drake.pose_set import load_pose_sets
from split_drake.pose_task import UnknownTaskError
from split_drake.split.checkpoint import CheckpointError, default_weights
from split_drake.station.cameras.egl import RenderingUnavailableError

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
        # They arrive as they end: with two workers the second may be first.
        runs.append(sorted(trial_run(folder).records(), key=lambda record: record.index))
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


class JumpingPlanner:
    """Plans as the default planner does, but for a jump of 2 rad on the way."""

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        plan = make_planner("default").plan(problem, rng)
        if isinstance(plan, PlanFailure):
            return plan
        transfer = next(each for each in plan.segments if each.name is SegmentName.TRANSFER)
        qs = transfer.trajectory.qs.copy()
        qs[len(qs) // 2 :, 6] += 2.0
        jumping = replace(transfer, trajectory=replace(transfer.trajectory, qs=qs))
        segments = [jumping if each is transfer else each for each in plan.segments]
        return replace(plan, segments=tuple(segments))


def test_a_plan_with_a_fault_is_not_executed_and_its_trial_has_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenarios.trials.trial.planner_named", lambda name: JumpingPlanner())
    options = {"detector": "oracle", "record": "none", "task": "reorient", "feedback": False}
    record = run_trial(spec_of(tmp_path, check_plans=True, **options))
    assert record.traceback is None, record.traceback
    assert record.outcome == Stage.CHECK == "refused by the checker"
    assert not record.succeeded
    assert record.violations
    assert record.reason == "; ".join(record.violations)
    assert not any("segments" in attempt for attempt in record.attempts), "nothing was executed"


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
    crashed = crashed_trial(spec_of(tmp_path, detector="oracle"))
    done = replace(crashed, outcome="grasp", reason="it slipped")
    run = claimed(tmp_path, trials=2)
    run.append(done)
    run.append(replace(done, index=1))
    main(MugHangOptions(trials=1, detector="oracle", out=tmp_path))
    assert run.records() == [done, replace(done, index=1)]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["trials"], summary["failures"]) == (1, {Stage.GRASP: 1})


def as_if_run(
    monkeypatch: pytest.MonkeyPatch, outcomes: dict[int, str]
) -> list[tuple[int, float | None]]:
    """Have trials end as told without being run; return those that were, with their limit."""
    asked: list[tuple[int, float | None]] = []

    class Pool:
        def __init__(self, *_: object, limit_s: float, **_more: object) -> None:
            self._limit_s = limit_s

        def run(self, specs: Sequence[TrialSpec]) -> Iterator[TrialRecord]:
            for spec in specs:
                asked.append((spec.index, self._limit_s))
                record = crashed_trial(spec, "EGL is missing")
                yield replace(record, outcome=outcomes[spec.index])

    monkeypatch.setattr("scenarios.mug_hang.make_pool", Pool)
    return asked


def test_errors_are_tried_again_and_alone_they_are_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = MugHangOptions(trials=2, detector="oracle", limit_s=90.0, out=tmp_path)
    asked = as_if_run(monkeypatch, {0: Stage.ERROR, 1: Stage.ERROR})
    message = f"^{tmp_path} holds no result: all 2 ended in an error, the first in: EGL is missing$"
    with pytest.raises(NoResultsError, match=message):
        main(options)
    assert asked == [(0, 90.0), (1, 90.0)]
    assert json.loads((tmp_path / "summary.json").read_text())["failures"] == {Stage.ERROR: 2}
    asked = as_if_run(monkeypatch, {0: SUCCESS, 1: Stage.ERROR})
    main(options)
    assert [index for index, _ in asked] == [0, 1]
    asked = as_if_run(monkeypatch, {1: Stage.GRASP})
    main(replace(options, limit_s=80.0))
    assert asked == [(1, 80.0)]
    outcomes = [record.outcome for record in trial_run(tmp_path).records()]
    assert outcomes == [SUCCESS, Stage.GRASP]


def test_what_no_trial_could_run_with_is_told_before_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("scenarios.mug_hang.make_pool")
    out = tmp_path / "run"
    clutter = default_weights().with_name("split_clutter.safetensors")
    with pytest.raises(UnknownTaskError, match=f"{clutter} has no task 'handle'; it has grasp"):
        main(MugHangOptions(trials=1, checkpoint=clutter, out=out))
    damaged = tmp_path / "split.safetensors"
    damaged.write_bytes(default_weights().read_bytes()[:-1])
    with pytest.raises(CheckpointError, match=f"{damaged} is damaged"):
        main(MugHangOptions(trials=1, checkpoint=damaged, out=out))

    def missing() -> None:
        raise RenderingUnavailableError("EGL has no driver")

    monkeypatch.setattr("scenarios.trials.detection.check_rendering", missing)
    with pytest.raises(BadInputError, match="depth cameras cannot render: EGL has no driver"):
        main(MugHangOptions(trials=1, detector="oracle", out=out))
    assert not out.exists()


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
        ("evaluations", 5, "--evaluations is 5; expected 4 or 16"),
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
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        start_new_session=True,
        # Shells let their background jobs ignore it, whose children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
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
