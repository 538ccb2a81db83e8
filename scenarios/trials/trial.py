"""One trial: draw a start, then perceive, plan, execute and judge."""

import logging
import time
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from planning.checking.checked_planner import CheckedPlanner
from planning.execution.executor import Executor
from planning.handling.attempts import Attempt, AttemptLimits, SequenceResult
from planning.handling.sequencer import Sequencer
from planning.planner import Planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Segment, SegmentName, Stage
from scenarios.trials.limit_log import LimitLog
from scenarios.trials.mug_tasks import mug_task
from scenarios.trials.perception import Perceiver
from scenarios.trials.records import SUCCESS, TrialRecord
from scenarios.trials.setup import TrialGenerators, planner_named, set_up
from scenarios.trials.spec import TrialSpec
from scenarios.viewing.film import Film
from scenarios.viewing.recording import Recorder, freeing_recorders
from split_drake.experiments.pool import WORKER_DIED
from split_drake.experiments.provenance import peak_memory_bytes
from split_drake.objects.mug_shape import MugShape
from split_drake.pose_set import PoseSet, save_pose_sets
from split_drake.pose_task import PoseTask
from split_drake.scene import Scene
from split_drake.truth.verdicts import Verdict

# Segments in which the hand is near what it handles.
_NEAR = frozenset(
    {
        SegmentName.APPROACH,
        SegmentName.CLOSE,
        SegmentName.INSERT,
        SegmentName.OPEN,
        SegmentName.RETREAT,
        SegmentName.EASE,
        SegmentName.BACK_OUT,
    }
)
# Of failed attempts, so many are pictured.
MOST_STILLS = 3


def run_trial(spec: TrialSpec) -> TrialRecord:
    """Run a trial.  One that throws is recorded as an error, with its traceback."""
    logging.getLogger("drake").setLevel(logging.WARNING)
    with freeing_recorders():
        return _run_trial(spec)


def _run_trial(spec: TrialSpec) -> TrialRecord:
    trial = None
    try:
        trial = _Trial(spec)
        return trial.carry_out()
    except Exception as error:
        mug = trial.setup.mug if trial else spec.load_mug(spec.mug_names()[0])
        failure = f"{type(error).__name__}: {error}"
        return _failed_trial(spec, mug, failure, traceback.format_exc())


def crashed_trial(spec: TrialSpec, reason: str = WORKER_DIED) -> TrialRecord:
    """Return the record of a trial whose process died, or was killed."""
    mug = spec.load_mug(spec.mug_names()[0])
    return _failed_trial(spec, mug, reason, None)


def _failed_trial(spec: TrialSpec, mug: MugShape, reason: str, trace: str | None) -> TrialRecord:
    return TrialRecord(
        index=spec.index,
        seed=spec.seed,
        mug=mug.body.name,
        mug_diameter_m=mug.outer_diameter_m,
        mesh_sha256=spec.mugs.mesh_sha256(mug.body.name),
        outcome=Stage.ERROR,
        reason=reason,
        traceback=trace,
    )


@dataclass
class _ShowingPlanner:
    """A planner whose plans are drawn into a recording, and counted."""

    planner: Planner
    recorder: Recorder
    plans: int = 0

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        outcome = self.planner.plan(problem, rng)
        self.plans += 1
        if isinstance(outcome, Plan):
            self.recorder.show_plan(outcome, taking=problem.held_width_m is None)
        return outcome


class _Trial:
    """The parts of a trial and what they draw their randomness from."""

    def __init__(self, spec: TrialSpec) -> None:
        self._spec = spec
        self._rngs = TrialGenerators.of(spec.seed)
        self._begun = time.monotonic()
        self.setup = set_up(spec, self._rngs)
        self._station, self._recorder = self.setup.station, self.setup.recorder
        self._perceiver = Perceiver(spec, self.setup, self._rngs)
        self._limits = LimitLog(self._station, self.setup.truth)
        self._checked: CheckedPlanner | None = None
        self._film = Film(self._station) if self._recorder else None
        self._lifting = False
        self._perceived: list[tuple[Scene, dict[str, PoseSet]]] = []

    def carry_out(self) -> TrialRecord:
        if self._recorder:
            self._recorder.start(self._station.time_s)
        if self._film:
            self._film.note()
        started_s, begun = self._station.time_s, time.monotonic()
        result = self._sequence().reach(self._spec.task, self._rngs.planner)
        executed = time.monotonic()
        verdict, outcome = self._judge(result)
        judged = time.monotonic()
        return TrialRecord(
            index=self._spec.index,
            seed=self._spec.seed,
            mug=self.setup.mug.body.name,
            mug_diameter_m=self.setup.mug.outer_diameter_m,
            mesh_sha256=self._spec.mugs.mesh_sha256(self.setup.mug.body.name),
            outcome=outcome,
            reason=verdict.reason,
            attempts=tuple(_attempt_record(attempt) for attempt in result.attempts),
            redraws=dict(self.setup.redraws),
            seconds={
                "start": begun - self._begun,
                "perception": result.perception_s,
                "planning": result.planning_s,
                "execution": result.execution_s,
                "verdict": judged - executed,
            },
            simulated_s=self._station.time_s - started_s,
            peaks=self._limits.peaks.rounded(),
            memory_bytes=peak_memory_bytes(),
            violations=self._violations(),
            recording=self._save_recording(verdict),
            film=self._save_film(verdict),
            stills=self._save_stills(result, verdict, started_s),
        )

    def _sequence(self) -> Sequencer:
        planner: Planner = planner_named(self._spec.planner)
        if self._spec.check_plans:
            planner = self._checked = CheckedPlanner(planner)
        if self._recorder:
            planner = self._showing = _ShowingPlanner(planner, self._recorder)
        on_step = self._on_step if self._recorder else None
        executor = Executor(self._station, on_step, stops_when_caught=self._spec.feedback)
        limits = AttemptLimits() if self._spec.feedback else AttemptLimits.without_feedback()
        return Sequencer(planner, self._perceive, executor, self._station.config.layout, limits)

    def _violations(self) -> tuple[str, ...] | None:
        if self._checked is None:
            return None
        return tuple(str(each) for each in self._checked.violations)

    def _perceive(self, tasks: Sequence[PoseTask], again: bool) -> tuple[Scene, dict[str, PoseSet]]:
        scene, pose_sets = self._perceiver.look(tasks, again)
        self._perceived.append((scene, pose_sets))
        if self._recorder:
            self._recorder.show_perception(scene.p_WPs, pose_sets, self._station.time_s)
        return scene, pose_sets

    def _on_step(self, segment: Segment) -> None:
        """Hide what was perceived once the object is moved; note how all stands."""
        if self._film:
            self._film.note()
        if self._recorder:
            time_s = self._station.time_s
            near = segment.name in _NEAR
            self._recorder.tell(time_s, max(1, self._showing.plans), segment.name, near)
            self._recorder.feel(time_s, -self._station.finger_forces_n)
        lifting = segment.name is SegmentName.LIFT
        if self._recorder and lifting and not self._lifting:
            self._recorder.hide_perception(self._station.time_s)
        self._lifting = lifting

    def _judge(self, result: SequenceResult) -> tuple[Verdict, str]:
        """Return the verdict, and the outcome in a word: a plan with a fault is a failure."""
        if faults := self._violations():
            return Verdict(False, "; ".join(faults)), Stage.CHECK
        if not result.completed:
            return Verdict(False, result.reason), result.stage or Stage.PLACEMENT
        judge = mug_task(self._spec.task).judge
        verdict = judge(self._station, self.setup.truth, self.setup.mug, result)
        return verdict, SUCCESS if verdict.success else Stage.PLACEMENT

    def _save_recording(self, verdict: Verdict) -> str | None:
        """Keep what was perceived and recorded where it is wanted; return the page's name."""
        wanted = self._spec.record == "all" or not verdict.success
        if self._recorder is None or not wanted:
            return None
        for number, (scene, pose_sets) in enumerate(self._perceived):
            file = f"poses/{self._spec.index:03d}-{number}.npz"
            save_pose_sets(self._spec.folder / file, pose_sets, scene.p_WPs)
        name = f"recordings/{self._spec.index:03d}.html"
        said = "success" if verdict.success else f"failed: {verdict.reason}"
        self._recorder.save(self._spec.folder / name, said, verdict.success)
        return name

    def _save_film(self, verdict: Verdict) -> str | None:
        """Keep a film of a failure; return its name."""
        if self._film is None or verdict.success:
            return None
        name = f"films/{self._spec.index:03d}.webp"
        self._film.save(self._spec.folder / name)
        return name

    def _save_stills(
        self, result: SequenceResult, verdict: Verdict, started_s: float
    ) -> tuple[tuple[str, str], ...]:
        """Keep pictures of where attempts failed, and of the end; return their names."""
        if self._film is None or not (self._spec.record == "all" or not verdict.success):
            return ()
        end_s = self._film.mark()
        moments = [
            (started_s + attempt.execution.logs[-1].ended_s, f"attempt {number}: {reason}")
            for number, attempt in enumerate(result.attempts, start=1)
            if (reason := attempt.failure[1]) and attempt.execution and attempt.execution.logs
        ]
        kept = []
        ends = [(end_s, "the end" if verdict.success else f"the end: {verdict.reason}")]
        for number, (time_s, shown) in enumerate(moments[:MOST_STILLS] + ends):
            name = f"stills/{self._spec.index:03d}-{number}.webp"
            self._film.save_still(self._spec.folder / name, time_s)
            kept.append((name, shown))
        return tuple(kept)


def _attempt_record(attempt: Attempt) -> dict[str, Any]:
    """Return what a record keeps of one planned and executed subgoal."""
    stage, reason = attempt.failure
    record: dict[str, Any] = {
        "subgoal": str(attempt.subgoal),
        "stage": str(stage or SUCCESS),
        "reason": reason,
        "recovery": attempt.recovery,
        "objects_in_view": attempt.perception.in_view,
        "poses": {name: len(found) for name, found in attempt.perception.pose_sets.items()},
        "planning_s": round(attempt.planning_s, 3),
        "search": dict(attempt.outcome.statistics),
    }
    if attempt.execution is not None:
        record["segments"] = [asdict(log) for log in attempt.execution.logs]
    if attempt.held is not None:
        record["held"] = {
            "shift_m": attempt.held.shift_m,
            "turn_rad": attempt.held.turn_rad,
            "matched": attempt.held.matched,
            "rejected": attempt.held.rejected,
        }
    return record
