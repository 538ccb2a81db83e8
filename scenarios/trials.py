"""One trial: draw a start, then perceive, plan, execute and judge."""

import logging
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from planning.executor import Executor
from planning.planner import Planner, make_planner
from planning.problem import (
    Plan,
    PlanFailure,
    PlanningProblem,
    Segment,
    SegmentName,
    Stage,
    Subgoal,
)
from planning.sequencer import Attempt, Sequencer, SequenceResult
from scenarios.recording import FRAMES_PER_SECOND, TrialRecorder
from scenarios.records import SUCCESS, TrialRecord
from split_drake.data.grasps import GraspLabels, sample_grasps
from split_drake.data.mugs import load_mug, mug_names
from split_drake.oracle import OracleDetector, Truth
from split_drake.pose_set import PoseDetector, PoseSet, PoseTask
from split_drake.scene import Scene
from split_drake.starts import draw_start, reject_for_hang, reject_for_reorient
from split_drake.station import Station
from split_drake.station_config import StationConfig
from split_drake.verdicts import Verdict, hang_verdict, reorient_verdict

if TYPE_CHECKING:
    from scenarios.mug_hang import MugHangOptions


@dataclass(frozen=True)
class TrialSpec:
    """Everything that determines a trial's outcome, and where it is recorded."""

    index: int
    seed: int
    mug: str
    task: Subgoal
    detector: str
    planner: str
    checkpoint: Path | None
    noise_m: float
    record: str
    folder: Path

    @classmethod
    def of(cls, options: "MugHangOptions", index: int, folder: Path) -> Self:
        """Return trial `index` of a run.  The mugs of the split take turns by seed."""
        seed = options.seed + index
        names = mug_names(options.mugs)
        return cls(
            index=index,
            seed=seed,
            mug=names[seed % len(names)],
            task=Subgoal(options.task),
            detector=options.detector,
            planner=options.planner,
            checkpoint=options.checkpoint,
            noise_m=options.noise_m,
            record=options.record,
            folder=folder,
        )


def run_trial(spec: TrialSpec) -> TrialRecord:
    """Run a trial.  One that throws is recorded as a simulator error, with its traceback."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    try:
        return _Trial(spec).run()
    except Exception as error:
        failure = f"{type(error).__name__}: {error}"
        return _failed_trial(spec, failure, traceback.format_exc())


def crashed_trial(spec: TrialSpec) -> TrialRecord:
    """Return the record of a trial whose process died."""
    return _failed_trial(spec, "the worker process died", None)


def _failed_trial(spec: TrialSpec, reason: str, trace: str | None) -> TrialRecord:
    return TrialRecord(
        index=spec.index,
        seed=spec.seed,
        mug=spec.mug,
        mug_diameter_m=load_mug(spec.mug).outer_diameter_m,
        outcome=Stage.SIMULATOR_ERROR,
        reason=reason,
        traceback=trace,
    )


@lru_cache(maxsize=1)
def _split_detector(checkpoint: Path | None) -> PoseDetector:
    """Return SPLIT, on one thread: results depend on the number of threads."""
    import torch

    from split_drake.split.detector import SplitDetector

    torch.set_num_threads(1)
    return SplitDetector.from_checkpoint(checkpoint)


@lru_cache(maxsize=4)
def _grasp_labels(mug: str) -> GraspLabels:
    """Return the true grasps of a mug, the same in every trial with it."""
    return sample_grasps(load_mug(mug), np.random.default_rng(0))


@lru_cache(maxsize=1)
def _planner(name: str) -> Planner:
    return make_planner(name)


@dataclass(frozen=True)
class _ShowingPlanner:
    """A planner whose plans are drawn into a recording."""

    planner: Planner
    recorder: TrialRecorder

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        outcome = self.planner.plan(problem, rng)
        if isinstance(outcome, Plan):
            self.recorder.show_plan(outcome)
        return outcome


class _Trial:
    """The parts of a trial and what they draw their randomness from.

    Start, noise, detector and planner have generators of their own, so that the same seed gives
    every detector and planner the same scene.
    """

    def __init__(self, spec: TrialSpec) -> None:
        self._spec = spec
        children = np.random.SeedSequence(spec.seed).spawn(4)
        self._start_rng, self._noise_rng, self._detector_rng, self._planner_rng = (
            np.random.default_rng(child) for child in children
        )
        self._mug = load_mug(spec.mug)
        self._recorder = None if spec.record == "none" else TrialRecorder()
        self._station = Station(
            StationConfig(meshcat_rate_hz=FRAMES_PER_SECOND),
            [self._mug.body],
            meshcat=self._recorder.meshcat if self._recorder else None,
        )
        self._truth = Truth(self._station)
        self._detector = self._make_detector()
        self._lifting = False

    def run(self) -> TrialRecord:
        begun = time.monotonic()
        reject = reject_for_hang if self._spec.task is Subgoal.HANG else reject_for_reorient
        start = draw_start(self._station, self._truth, self._start_rng, reject)
        if self._recorder:
            self._recorder.start(self._station.time_s)
        started_s, set_up = self._station.time_s, time.monotonic()
        result = self._sequence().run(self._spec.task, self._planner_rng)
        executed = time.monotonic()
        verdict = self._judge(result)
        judged = time.monotonic()
        return TrialRecord(
            index=self._spec.index,
            seed=self._spec.seed,
            mug=self._spec.mug,
            mug_diameter_m=self._mug.outer_diameter_m,
            outcome=SUCCESS if verdict.success else result.stage or Stage.PLACEMENT,
            reason=verdict.reason,
            attempts=tuple(_attempt_record(attempt) for attempt in result.attempts),
            redraws=dict(Counter(start.redraws)),
            seconds={
                "start": set_up - begun,
                "perception": result.perception_s,
                "planning": result.planning_s,
                "execution": result.execution_s,
                "verdict": judged - executed,
            },
            simulated_s=self._station.time_s - started_s,
            recording=self._save_recording(verdict),
        )

    def _make_detector(self) -> PoseDetector:
        if self._spec.detector == "split":
            return _split_detector(self._spec.checkpoint)
        return OracleDetector(self._truth, self._mug, _grasp_labels(self._spec.mug))

    def _sequence(self) -> Sequencer:
        planner: Planner = _planner(self._spec.planner)
        if self._recorder:
            planner = _ShowingPlanner(planner, self._recorder)
        executor = Executor(self._station, on_step=self._on_step if self._recorder else None)
        return Sequencer(planner, self._perceive, executor, self._station.config.layout)

    def _perceive(self, tasks: Sequence[PoseTask]) -> tuple[Scene, dict[PoseTask, PoseSet]]:
        layout = self._station.config.layout
        clean = Scene.from_views(self._station.capture(), layout.workspace)
        scene = clean.with_noise(self._spec.noise_m, self._noise_rng)
        pose_sets = self._detector.detect(scene, tasks, self._detector_rng)
        if self._recorder:
            self._recorder.show_perception(scene.p_WPs, pose_sets, self._station.time_s)
        return scene, pose_sets

    def _on_step(self, segment: Segment) -> None:
        """Hide what was perceived once the object is moved."""
        lifting = segment.name is SegmentName.LIFT
        if self._recorder and lifting and not self._lifting:
            self._recorder.hide_perception(self._station.time_s)
        self._lifting = lifting

    def _judge(self, result: SequenceResult) -> Verdict:
        if not result.completed:
            return Verdict(False, result.reason)
        if self._spec.task is Subgoal.REORIENT:
            return reorient_verdict(self._station, self._truth)
        released_s = self._station.time_s - _time_since_release(result)
        return hang_verdict(self._station, self._truth, self._mug, released_s)

    def _save_recording(self, verdict: Verdict) -> str | None:
        wanted = self._spec.record == "all" or not verdict.success
        if self._recorder is None or not wanted:
            return None
        name = f"recordings/{self._spec.index:03d}.html"
        self._recorder.save(self._spec.folder / name)
        return name


def _time_since_release(result: SequenceResult) -> float:
    """Return the simulated seconds since the last plan's fingers had opened."""
    execution = result.attempts[-1].execution
    assert execution is not None
    names = [log.name for log in execution.logs]
    after = len(names) - names[::-1].index(SegmentName.OPEN)
    return sum(log.duration_s for log in execution.logs[after:])


def _attempt_record(attempt: Attempt) -> dict[str, Any]:
    """Return what a record keeps of one planned and executed subgoal."""
    outcome, execution = attempt.outcome, attempt.execution
    record: dict[str, Any] = {
        "subgoal": str(attempt.subgoal),
        "poses": {str(task): len(found) for task, found in attempt.perception.pose_sets.items()},
        "planning_s": round(attempt.planning_s, 3),
        "search": dict(outcome.statistics),
    }
    if isinstance(outcome, PlanFailure):
        return record | {"stage": str(outcome.stage), "reason": outcome.reason}
    if execution is not None:
        record["segments"] = [asdict(log) for log in execution.logs]
        record["stage"] = str(execution.stage or SUCCESS)
        record["reason"] = execution.reason
    return record
