"""Hang unseen mugs on a hook, or stand them upright: `python -m scenarios.mug_hang --trials 40`.

Each trial drops a mug on the table, looks at it with two depth cameras, detects pose sets, plans,
executes in contact physics, and judges.  The output folder holds config.json, trials.jsonl (a line
as each trial ends), summary.json, recordings/*.html, poses/*.npz (each perception, for
`scenarios.view_poses`) and index.html.  The same --out goes on where an interrupted run stopped.
"""

import math
import os
import time
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from rich.console import Console

from planning.planner import planner_names
from planning.subgoal import find_subgoal
from scenarios.trials.detection import (
    require_working_detector,
    station_of,
    trial_detector,
    trial_detectors,
)
from scenarios.trials.mug_check import GRASPS, MugCheck, keep_grasps
from scenarios.trials.mug_tasks import MugTaskName
from scenarios.trials.pose_noise import PoseNoise
from scenarios.trials.records import TrialRecord, success_rate, trial_run
from scenarios.trials.report.page import write_report
from scenarios.trials.report.summary import print_report, run_title
from scenarios.trials.spec import TrialSpec
from scenarios.trials.trial import crashed_trial, run_trial
from split_drake.bad_input import require_number, require_numbers
from split_drake.depth_noise import DepthNoiseLevel
from split_drake.experiments.command import run_command
from split_drake.experiments.pools import LOCAL, make_pool, require_scheduler
from split_drake.experiments.provenance import code_version, file_sha256
from split_drake.experiments.run import RunFolder, as_json, require_results
from split_drake.experiments.shards import Shard
from split_drake.files import interpreting, read_json_object, write_atomically
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import UsableMugs, usable_mugs
from split_drake.scene import MAX_NOISE_M
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import station_to_yaml


@dataclass(frozen=True)
class MugHangOptions:
    """Options of a run.

    Attributes:
        trials: how many; trial i is seeded by seed + i alone.
        seed: of the first trial.
        detector: "split", "oracle" for the true poses, or another file in
            scenarios/trials/detectors.
        task: hang (with a reorientation where no hanging plan exists), or reorient alone.
        mugs: "test", shapes unlike those the model was trained on, "thin", such with grips of 2 to
            3 mm and walls of 1.5 to 13 mm, "train", or a folder of meshes, of which those that
            `python -m scenarios.check_meshes` refuses are left out.
        planner: by name.
        checkpoint: weights of SPLIT; those that ship with the project where not given.
        evaluations: of SPLIT's score for a look; 16 take three times the time, and 200 trials of
            each end alike.
        noise_m: standard deviation of the noise on the sampled points.
        depth_noise: of the depth images themselves, which detector, planner and registration see:
            levels of `split_drake.depth_noise`.
        station: a YAML file of where cameras, table and hook stand, see
            split_drake/station/file/station_file.py; the usual station where not given.
        objects: other things that stand beside the mug: boxes, bowls, cans and such.
        pose_noise_mm, pose_noise_deg: standard deviations, along and about each axis, of Gaussian
            noise on every pose of the oracle, drawn by the trial's seed.
        feedback: look at what was lifted and place it as it lies in the hand, and try again what
            failed; else plans are executed as they are.
        check_plans: check every plan independently, see planning.checking.checked_planner; one with
            a fault is not executed, and its trial has failed.  Counts as planning time.
        shard: such as 2/5, the second of five parts of the run, for machines that know nothing of
            each other; `scenarios.merge` makes them one.
        workers: processes; outcomes do not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
        record: which trials keep a recording and the pose sets they perceived.
        limit_s: a trial that takes longer is ended, and recorded as an error; so generous that no
            outcome depends on it.
        out: folder of the results; runs/mug_hang/<time> where not given.
    """

    trials: int = 40
    seed: int = 0
    detector: str = "split"
    task: MugTaskName = "hang"
    mugs: str = "test"
    planner: str = "default"
    checkpoint: Path | None = None
    evaluations: Literal[4, 16] = 4
    noise_m: float = 0.005
    depth_noise: DepthNoiseLevel | None = None
    station: Path | None = None
    objects: int = 0
    pose_noise_mm: float = 0.0
    pose_noise_deg: float = 0.0
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL
    feedback: bool = True
    check_plans: bool = False
    shard: str | None = None
    record: Literal["all", "failures", "none"] = "all"
    limit_s: float = 1800.0
    out: Path | None = None

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if not self.limit_s > 0.0:
            raise ValueError(f"--limit-s is {self.limit_s}; expected seconds > 0")
        if self.trials < 1:
            raise ValueError(f"--trials is {self.trials}; expected at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; expected 0 or more")
        if self.workers < 1:
            raise ValueError(f"--workers is {self.workers}; expected at least 1")
        if self.objects < 0:
            raise ValueError(f"--objects is {self.objects}; expected 0 or more")
        require_number(
            "--noise-m", self.noise_m, 0.0, MAX_NOISE_M, "a standard deviation in metres"
        )
        for name in ("pose_noise_mm", "pose_noise_deg"):
            if not 0.0 <= getattr(self, name) < math.inf:
                flag = name.replace("_", "-")
                raise ValueError(f"--{flag} is {getattr(self, name)}; expected 0 or more")
        detector = trial_detector(self.detector)
        if self.pose_noise and not detector.knows_truth:
            known = " or ".join(
                name for name, each in trial_detectors().items() if each.knows_truth
            )
            raise ValueError(
                f"--pose-noise-mm and --pose-noise-deg go with --detector {known}, whose poses are "
                f"true; --detector is {self.detector!r}"
            )
        MugSource(self.mugs)
        if self.shard is not None:
            Shard.parse(self.shard)
        if self.planner not in planner_names():
            raise ValueError(f"--planner is {self.planner!r}; expected one of {planner_names()}")
        if self.evaluations not in (4, 16):
            raise ValueError(f"--evaluations is {self.evaluations}; expected 4 or 16")
        if self.checkpoint is not None and not self.checkpoint.is_file():
            raise ValueError(f"--checkpoint: there is no file {self.checkpoint}")

    @property
    def pose_noise(self) -> PoseNoise:
        """The noise on the oracle's poses, in SI units."""
        return PoseNoise(1e-3 * self.pose_noise_mm, math.radians(self.pose_noise_deg))


# What may differ when a run goes on: none of it changes an outcome.
FREE_KEYS = ("trials", "workers", "scheduler", "record", "limit_s", "out")


def run_config(options: MugHangOptions, mugs: UsableMugs | None = None) -> dict[str, Any]:
    """Return the content of config.json; `mugs` are those of a folder that are usable."""
    config = as_json(asdict(options))
    mugs = mugs or UsableMugs(MugSource(options.mugs))
    if mugs.source.folder is not None:
        names = mugs.source.names()
        config["mesh_sha256"] = {name: mugs.source.mesh_sha256(name) for name in names}
        config["refused_meshes"] = mugs.refused
        config["assumed_of_meshes"] = mugs.remarks
    config["station_sha256"] = None if options.station is None else file_sha256(options.station)
    weights = trial_detector(options.detector).weights(options.checkpoint)
    config["checkpoint_sha256"] = None if weights is None else file_sha256(weights)
    return {**config, **code_version()}


def specs_of(
    options: MugHangOptions,
    folder: Path,
    done: Collection[int],
    mugs: MugSource | None = None,
) -> list[TrialSpec]:
    """Return the trials of a run, without those whose indices are `done`.

    They are with `mugs`, or with all that the options name.
    """
    station = asked_station(options)
    part = None if options.shard is None else Shard.parse(options.shard)
    return [
        TrialSpec(
            index=index,
            seed=options.seed + index,
            mugs=mugs or MugSource(options.mugs),
            task=find_subgoal(options.task),
            detector=options.detector,
            planner=options.planner,
            checkpoint=options.checkpoint,
            evaluations=options.evaluations,
            noise_m=options.noise_m,
            record=options.record,
            folder=folder,
            station=station,
            pose_noise=options.pose_noise,
            feedback=options.feedback,
            check_plans=options.check_plans,
            objects=options.objects,
        )
        for index in range(options.trials)
        if index not in done and (part is None or part.takes(index))
    ]


def asked_station(options: MugHangOptions) -> StationConfig:
    """Return the station of the trials: the usual one, or a file's, with the noise asked for.

    Raises BadInputError where the file cannot be used.
    """
    station = station_of(options.detector, options.checkpoint, options.station)
    if options.depth_noise is None:
        return station
    return replace(station, depth_noise=options.depth_noise)


def earlier_wall_s(folder: Path) -> float:
    """Return the wall time that the run has taken before."""
    path = folder / "summary.json"
    if not path.exists():
        return 0.0
    with interpreting(path, what := "the summary of a run"):
        return float(read_json_object(path, what)["wall_s"])


def run_missing(
    run: RunFolder[TrialRecord], specs: list[TrialSpec], options: MugHangOptions, console: Console
) -> None:
    """Run the trials, and log each as it ends."""
    pool = make_pool(
        options.scheduler,
        options.workers,
        run_trial,
        crashed_trial,
        limit_s=options.limit_s,
        run=run.path,
        kept=(GRASPS,),
    )
    run.collect(
        pool.run(specs),
        len(specs),
        console,
        describe=lambda records: str(success_rate(records)),
        remark=_failure,
    )


def _failure(record: TrialRecord) -> str:
    """Return a line that says how a trial failed; an empty one where it did not."""
    if record.succeeded:
        return ""
    return f"trial {record.index} ({record.mug}): {record.outcome}: {record.reason}"


def main(options: MugHangOptions) -> Path:
    """Run what is missing of the trials, report, and return the folder.

    Trials that ended in an error are tried again.  Raises NoResultsError where all of them did.
    """
    console = Console()
    require_scheduler(options.scheduler)
    started = time.monotonic()
    folder = options.out or Path("runs/mug_hang") / datetime.now().strftime("%Y%m%d-%H%M%S")
    run = trial_run(folder)
    require_working_detector(options.detector, options.checkpoint, find_subgoal(options.task))
    with TemporaryDirectory() as scratch:
        mugs = find_usable_mugs(options, folder, Path(scratch), console)
        config = run_config(options, mugs)
        with run.claim(config, FREE_KEYS, again=lambda record: record.failed_to_run):
            keep_grasps(Path(scratch), folder)
            asked = run_claimed(run, options, config, mugs.source, console, started)
    print_report(console, asked, run_title(config))
    console.print(f"results: {folder / 'index.html'}")
    errors = [record.reason for record in asked if record.failed_to_run]
    require_results(errors, len(asked), folder)
    return folder


def run_claimed(
    run: RunFolder[TrialRecord],
    options: MugHangOptions,
    config: dict[str, Any],
    mugs: MugSource,
    console: Console,
    started: float,
) -> list[TrialRecord]:
    """Run what is missing of the trials in a claimed folder, report, and return what was asked."""
    folder = run.path
    before_s = earlier_wall_s(folder)
    write_atomically(folder / "station.yaml", station_to_yaml(asked_station(options)))
    specs = specs_of(options, folder, {record.index for record in run.records()}, mugs)
    try:
        run_missing(run, specs, options, console)
    finally:
        run.require_unchanged()
        asked = asked_records(options, run.records())
        write_report(folder, asked, config, before_s + time.monotonic() - started)
    return asked


def find_usable_mugs(
    options: MugHangOptions, folder: Path, scratch: Path, console: Console
) -> UsableMugs:
    """Return which of the user's own mugs can be simulated; their true grasps go to `scratch`."""
    station = asked_station(options)
    with_grasps = scratch if trial_detector(options.detector).knows_truth else None
    trial = MugCheck(station, with_grasps, folder)
    return usable_mugs(MugSource(options.mugs), options.workers, console, trial)


def asked_records(options: MugHangOptions, records: Sequence[TrialRecord]) -> list[TrialRecord]:
    """Return the records that the options ask for, by their numbers."""
    asked = [record for record in records if record.index < options.trials]
    return sorted(asked, key=lambda record: record.index)


if __name__ == "__main__":
    run_command(main, MugHangOptions, __doc__)
