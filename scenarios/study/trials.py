"""The trials of the physics study: a mug held still, or picked and hung, in a cell's physics."""

import logging
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from planning.problem import Stage
from planning.subgoal import find_subgoal
from scenarios.study.cells import Cell
from scenarios.trials.records import SUCCESS
from scenarios.trials.spec import TrialSpec
from scenarios.trials.trial import run_trial
from split_drake.experiments.pool import WORKER_DIED
from split_drake.experiments.run import RunFolder
from split_drake.grasps.free_hand import FreeHand
from split_drake.grasps.store import load_checked_grasps
from split_drake.objects.scanned.mug_source import MugSource

MUGS = MugSource("test")
# As in mug_hang.
_NOISE_M = 0.005


@dataclass(frozen=True)
class StudyTrial:
    """What is to be simulated.

    Attributes:
        cell: whose physics.
        index: of the trial in its cell.
        seed: of the mug, the grasp, and how the mug is dropped; the same in every cell.  Where it
            comes to lie follows the cell's physics.
        hold_s: how long a mug is held.
        folder: of the study.
    """

    cell: Cell
    index: int
    seed: int
    hold_s: float
    folder: Path


@dataclass(frozen=True)
class StudyRecord:
    """What became of it.

    Attributes:
        cell: its name.
        index, seed: as in `StudyTrial`.
        mug: name of the shape.
        outcome: "success", the stage that failed, or the fault of a hold.
        reason: why, in words.
        figures: of a hold: penetration_m, slip_m, turn_rad, and real_time_factor, simulated
            seconds a second of the processor.
    """

    cell: str
    index: int
    seed: int
    mug: str
    outcome: str
    reason: str = ""
    figures: dict[str, float] = field(default_factory=dict)

    @property
    def succeeded(self) -> bool:
        return self.outcome == SUCCESS

    @property
    def failed_to_run(self) -> bool:
        """Whether an error, a crash or the limit of time ended it: it is tried again."""
        return self.outcome == Stage.ERROR


def study_run(folder: Path) -> RunFolder[StudyRecord]:
    """Return the folder of a study, whose log is trials.jsonl."""
    return RunFolder(folder, "trials.jsonl", lambda fields: StudyRecord(**fields))


def run_study_trial(trial: StudyTrial) -> StudyRecord:
    """Run a trial; one whose simulation throws is recorded with the error."""
    logging.getLogger("drake").setLevel(logging.ERROR)
    return _hold(trial) if trial.cell.kind == "hold" else _hang(trial)


def crashed_study_trial(trial: StudyTrial, reason: str = WORKER_DIED) -> StudyRecord:
    """Return the record of a trial whose process died, or was killed."""
    return _record(trial, _mug_of(trial), Stage.ERROR, reason)


def _hang(trial: StudyTrial) -> StudyRecord:
    spec = TrialSpec(
        index=trial.index,
        seed=trial.seed,
        mugs=MUGS,
        task=find_subgoal("hang"),
        detector="oracle",
        planner="default",
        checkpoint=None,
        noise_m=_NOISE_M,
        record="none",
        folder=trial.folder,
        station=trial.cell.station,
        mass_kg=trial.cell.mass_kg,
    )
    record = run_trial(spec)
    return _record(trial, record.mug, record.outcome, record.reason)


def _hold(trial: StudyTrial) -> StudyRecord:
    """Hold the seed's mug by one of its checked grasps, gravity in a random direction."""
    name = _mug_of(trial)
    rng = np.random.default_rng(trial.seed)
    grasps = load_checked_grasps("test", name)
    chosen = int(rng.choice(np.flatnonzero(grasps.holds)))
    down = rng.normal(size=3)
    hand = FreeHand(MUGS.load(name).body, trial.cell.station)
    started_s = time.process_time()
    try:
        held = hand.hold_still(
            grasps.X_OGs[chosen],
            float(grasps.openings_m[chosen]),
            down / np.linalg.norm(down),
            trial.hold_s,
        )
    except RuntimeError as error:  # Drake's contact solver
        return _record(trial, name, Stage.ERROR, str(error))
    spent_s = time.process_time() - started_s
    figures = {
        "penetration_m": held.penetration_m,
        "slip_m": held.slip_m,
        "turn_rad": held.turn_rad,
        "real_time_factor": held.simulated_s / spent_s,
    }
    kept = {key: round(value, 7) for key, value in figures.items() if np.isfinite(value)}
    return _record(trial, name, held.fault or SUCCESS, "", kept)


def _mug_of(trial: StudyTrial) -> str:
    names = MUGS.names()
    return names[trial.seed % len(names)]


def _record(
    trial: StudyTrial, mug: str, outcome: str, reason: str, figures: dict[str, float] | None = None
) -> StudyRecord:
    name = trial.cell.name
    return StudyRecord(name, trial.index, trial.seed, mug, outcome, reason, figures or {})
