"""Record planning problems from trials' starts: `python -m scenarios.record_problems --count 500`.

Each start is drawn and perceived as in a trial of `scenarios.mug_hang` with the same seed; nothing
is planned or executed.  Of what its planner would be asked first the file keeps the best 128 grasps
and 32 handle and upright poses, and the cloud thinned to 4 mm.  Tasks and detectors take turns:
problems of one seed share their scene, but where a start serves one task and not the other.
`scenarios.planner_bench` runs planners on the file.  Interrupted, the same command goes on.
"""

import logging
import os
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
from rich.console import Console

from planning.collision.world import CollisionWorld, Situation
from planning.geometry.focus import focus_on_one
from planning.geometry.perceived import OBSTACLE_VOXEL_M, voxel_centroids
from planning.problem import PlanningProblem
from planning.problem_files import compact, save_problems
from planning.subgoal import find_subgoal
from scenarios.bench.recorded import Recorded, load_recorded, save_recorded
from scenarios.trials.detection import (
    require_working_detector,
    station_of,
    trial_detector,
)
from scenarios.trials.mug_check import GRASPS, MugCheck
from scenarios.trials.mug_tasks import MUG_TASK_NAMES, MugTaskName
from scenarios.trials.perception import Perceiver
from scenarios.trials.setup import TrialGenerators, set_up
from scenarios.trials.spec import TrialSpec
from split_drake.bad_input import require_count, require_number, require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.parts import Parts, parts_of
from split_drake.experiments.pools import LOCAL, make_pool, require_scheduler
from split_drake.experiments.provenance import code_version, file_sha256
from split_drake.experiments.run import NoResultsError
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import usable_mugs
from split_drake.pose_task import GRASP
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import HIGHEST_Q, LOWEST_Q
from split_drake.scene import MAX_NOISE_M, EmptySceneError
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.truth.starts import NoStartError

# Poses kept of each pose set, best first.
MAX_POSES, MAX_OTHERS = {GRASP.name: 128}, 32

# A problem takes seconds.
_LIMIT_S = 600.0
# Starts are drawn from a stream of their own, so that scenes are those of trials.
_START_STREAM = 7
_LEAST_DESCENT = 0.5
# What may differ when a recording goes on: it changes no problem.
_FREE_KEYS = ("workers", "scheduler", "out")
Starts = Literal["home", "any"]


@dataclass(frozen=True)
class RecordOptions:
    """Options of a recording.

    Attributes:
        count: of problems.
        seed: of the first trials; every task and detector in turn gets the same seeds.
        tasks: subgoals that problems are recorded for.
        detectors: that pose sets come from.
        mugs: "test", shapes unlike those the model was trained on, "train", or a folder of meshes,
            of which those that `python -m scenarios.check_meshes` refuses are left out.
        station: YAML files of where cameras, table and hook stand, see
            split_drake/station/file/station_file.py; trials take them in turns.  The usual station
            where none is given.
        objects: other things that stand beside the mug, and are in the way.
        starts: where the arm is: at home, or anywhere that it touches nothing.
        noise_m: standard deviation of the noise on the sampled points.
        checkpoint: weights of SPLIT; those that ship with the project where not given.
        workers: processes; the file does not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
        out: the file.
    """

    count: int = 500
    seed: int = 0
    tasks: tuple[MugTaskName, ...] = MUG_TASK_NAMES
    detectors: tuple[str, ...] = ("split", "oracle")
    mugs: str = "test"
    station: tuple[Path, ...] = ()
    objects: int = 0
    starts: Starts = "home"
    noise_m: float = 0.005
    checkpoint: Path | None = None
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL
    out: Path = Path("runs/problems/mugs.npz")

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if self.count < 1:
            raise ValueError(f"--count is {self.count}; expected at least 1")
        if not self.tasks or not self.detectors:
            raise ValueError("--tasks and --detectors must each name at least one")
        for name in ("tasks", "detectors"):
            named = getattr(self, name)
            if len(set(named)) < len(named):
                raise ValueError(f"--{name} names one twice: {list(named)}")
        for name in self.detectors:
            trial_detector(name)
        for name in ("seed", "objects"):
            require_count(f"--{name}", getattr(self, name))
        require_number(
            "--noise-m", self.noise_m, 0.0, MAX_NOISE_M, "a standard deviation in metres"
        )
        if self.workers < 1:
            raise ValueError(f"--workers is {self.workers}; expected at least 1")
        MugSource(self.mugs)


def specs_of(
    options: RecordOptions, mugs: MugSource | None = None, grasps: Path | None = None
) -> list[TrialSpec]:
    """Return the trials whose starts are recorded.

    They are with `mugs`, or with all that the options name; true grasps of the user's own mugs lie
    in the folder `grasps`.
    """
    kinds = list(product(options.detectors, options.tasks))
    specs = []
    for index in range(options.count):
        detector, task = kinds[index % len(kinds)]
        specs.append(
            TrialSpec(
                index=index,
                seed=options.seed + index // len(kinds),
                mugs=mugs or MugSource(options.mugs),
                task=find_subgoal(task),
                detector=detector,
                planner="default",
                checkpoint=options.checkpoint,
                noise_m=options.noise_m,
                record="none",
                folder=grasps or options.out.parent,
                station=_station(options, detector, index // len(kinds)),
                objects=options.objects,
            )
        )
    return specs


def _station(options: RecordOptions, detector: str, turn: int) -> StationConfig:
    """Return the station of a turn's trials."""
    files = options.station
    return station_of(detector, options.checkpoint, files[turn % len(files)] if files else None)


def record_problem(starts: Starts, spec: TrialSpec) -> Recorded:
    """Return the problem that a trial's planner is asked first, made compact."""
    mugs = spec.mugs.where if spec.mugs.folder is None else spec.mugs.folder.resolve().name
    name = f"{spec.task}-{spec.detector}-{mugs}-{spec.seed}"
    rngs = TrialGenerators.of(spec.seed)
    try:
        setup = set_up(spec, rngs)
        tasks = spec.task.perceived_tasks
        scene, pose_sets = Perceiver(spec, setup, rngs).look(tasks)
    except (NoStartError, EmptySceneError) as error:
        return Recorded(spec.index, name, None, str(error))
    seen = focus_on_one(scene.p_WPs, pose_sets, tasks)
    layout = setup.station.config.layout
    q_start = setup.station.q
    if starts == "any":
        q_start = free_start(layout, scene.p_WPs, np.random.default_rng([spec.seed, _START_STREAM]))
    problem = PlanningProblem(
        spec.task, seen.pose_sets, seen.p_WPs, q_start, layout, p_WObstacles=seen.p_WObstacles
    )
    return Recorded(spec.index, name, compact(problem, MAX_POSES, MAX_OTHERS))


def free_start(layout: Layout, p_WPs: Array, rng: np.random.Generator) -> Array:
    """Return a configuration (7,) of the arm, uniform among those where it touches nothing.

    What stands there is a cloud (N, 3).  The open hand points within 60 degrees of straight down:
    starts are such as a task before may have ended in.
    """
    logging.getLogger("drake").setLevel(logging.WARNING)  # a line for each world
    world = CollisionWorld(layout)
    situation = Situation(MAX_OPENING_M, p_WStanding=voxel_centroids(p_WPs, OBSTACLE_VOXEL_M))
    while True:
        q = rng.uniform(LOWEST_Q, HIGHEST_Q)
        if gripper_pose(q)[2, 2] < -_LEAST_DESCENT and world.free(q[None], situation)[0]:
            return np.asarray(q)


def _crashed(spec: TrialSpec, reason: str) -> Recorded:
    return Recorded(spec.index, f"seed {spec.seed}", None, reason, crashed=True)


def record(
    options: RecordOptions, mugs: MugSource, grasps: Path, parts: Parts, console: Console
) -> dict[str, PlanningProblem]:
    """Return the problems of all starts by their names; true grasps lie in the folder `grasps`.

    Those in `parts` are not recorded again, and each other one is put there.  Where the recording
    of one crashed they stay, so that the same command tries it again.
    """
    specs = specs_of(options, mugs, grasps)
    pool = make_pool(
        options.scheduler,
        options.workers,
        partial(record_problem, options.starts),
        _crashed,
        limit_s=_LIMIT_S,
        run=grasps,
        kept=(GRASPS,),
    )
    found: dict[int, Recorded] = {}

    def keep(recorded: Recorded) -> None:
        found[recorded.index] = recorded
        if not recorded.crashed:
            save_recorded(parts.path(recorded.index), recorded)

    parts.make(specs, pool.run, keep, "recording", console)
    for spec in specs:
        if spec.index not in found:
            found[spec.index] = load_recorded(parts.path(spec.index), spec.index)
    problems = {}
    for recorded in (found[spec.index] for spec in specs):
        if recorded.problem is None:
            console.print(f"{recorded.name}: left out: {recorded.reason}", markup=False)
        else:
            problems[recorded.name] = recorded.problem
    if any(recorded.crashed for recorded in found.values()):
        parts.stay = True
        console.print("the same command tries again what crashed, and goes on with the rest")
    return problems


def recording_config(options: RecordOptions, mugs: MugSource) -> dict[str, Any]:
    """Return what tells whether parts of a recording are of the same one."""
    weights = {name: trial_detector(name).weights(options.checkpoint) for name in options.detectors}
    return {
        **asdict(options),
        "mugs_sha256": mugs.mugs_sha256(),
        "station_sha256": [file_sha256(file) for file in options.station],
        "weights_sha256": {name: file and file_sha256(file) for name, file in weights.items()},
        **code_version(),
    }


def main(options: RecordOptions) -> Path:
    """Record the problems, and return their file; interrupted, the same call goes on."""
    console = Console()
    require_scheduler(options.scheduler)
    for detector, task in product(options.detectors, options.tasks):
        require_working_detector(detector, options.checkpoint, find_subgoal(task))
    station = _station(options, options.detectors[0], 0)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as scratch:
        grasps = Path(scratch)
        any_true = any(trial_detector(name).knows_truth for name in options.detectors)
        trial = MugCheck(station, grasps if any_true else None, grasps)
        mugs = usable_mugs(MugSource(options.mugs), options.workers, console, trial).source
        with parts_of(options.out, recording_config(options, mugs), _FREE_KEYS) as parts:
            problems = record(options, mugs, grasps, parts, console)
            if problems:
                save_problems(options.out, problems)
    if not problems:
        raise NoResultsError(f"none of {options.count} starts gave a problem; nothing is written")
    megabytes = options.out.stat().st_size / 1e6
    console.print(f"{len(problems)} problems, {megabytes:.2f} MB: {options.out}", markup=False)
    return options.out


if __name__ == "__main__":
    run_command(main, RecordOptions, __doc__)
