"""Clear tables of unknown objects: `python -m scenarios.clutter_removal --scene pile`.

A floating hand tries grasps that are detected in one view from the side, and takes what it holds,
until nothing is left, nothing is found, or two grasps in a row fail.  With --robot arm it is the
station's Panda, which plans, and drops what it holds into a bin.

The folder holds config.json, rounds.jsonl (a line as each round ends, with every grasp),
summary.json, recordings/*.html and index.html; the same --out goes on where an interrupted run
stopped.
"""

import os
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from scenarios.clutter.arm_clearing import arm_layout
from scenarios.clutter.detection import clutter_detector
from scenarios.clutter.observation import Noise
from scenarios.clutter.records import Removal, RoundRecord, clutter_run
from scenarios.clutter.report import print_removal, run_title, write_report
from scenarios.clutter.rounds import crashed_round, run_round
from scenarios.clutter.spec import (
    Recorded,
    Robot,
    RoundSpec,
    SceneKind,
    Selection,
    object_source,
    round_station,
)
from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.pools import LOCAL, make_pool, require_scheduler
from split_drake.experiments.provenance import code_version, file_sha256
from split_drake.experiments.run import require_results
from split_drake.experiments.shards import Shard
from split_drake.objects.meshes.mesh_file import ObjectFileError
from split_drake.station.cameras.egl import check_rendering
from split_drake.station.layout import Layout

_FREE_KEYS = ("rounds", "seeds", "workers", "scheduler", "record", "limit_s", "out")
# Of a run's folder, what rounds read again.
_KEPT = ("decompositions",)


@dataclass(frozen=True)
class ClutterOptions:
    """Options of a run.

    Attributes:
        scene: how objects lie when a round starts: packed, standing side by side, or in a pile.
        rounds: of each seed.
        seeds: how many seeds there are, from `first_seed` on.
        first_seed: of them.
        detector: the method that finds grasps: split, split_16 (sixteen network evaluations in
            place of four), split_once (without a second look), split_8 (that, and eight
            evaluations), oracle (the true ones of what lies there), vgn, giga, se3dif (of the whole
            scene) or se3dif_segments; each is a file in scenarios/clutter/detectors.
        checkpoint: its parameters: of split such as models/weights/split_clutter.safetensors, of
            the others weights of split_drake.baselines.learning.train; of vgn and giga the state
            dictionary that their authors published will do, too.
        objects: "procedural", kinds that no model was trained on; "procedural-train", those to
            choose settings on; or a folder of URDF or mesh files in metres.
        noise: of the view: "gaussian" moves the sampled points by 5 mm (and the pixels, for methods
            that read the image), "dex" scales the image by 3% and adds a smooth error.
        fit_table: put the scale of the depth image right by the table that it shows, for cameras
            that misjudge all distances by one factor.
        select: the best of the grasps that are found, or any of them.
        robot: a floating hand, which can try any grasp; or the arm, which tries the first that it
            can plan, and has succeeded with what it brings into the bin.
        record: which rounds keep a recording for the browser; failures are rounds in which a grasp
            failed or something was left.
        shard: such as 2/5, the second of five parts of the run, for machines that know nothing of
            each other; `scenarios.merge` makes them one.
        workers: processes; outcomes do not depend on them.
        scheduler: "local", or where Dask's scheduler is, such as tcp://10.0.0.5:8786; see
            split_drake/experiments/cluster/README.md.
        limit_s: a round that takes longer is ended, and recorded as such; so generous that no
            outcome depends on it.
        out: folder of the results; runs/clutter_removal/<time> where not given.
    """

    scene: SceneKind
    rounds: int = 40
    seeds: int = 5
    first_seed: int = 0
    detector: str = "split"
    checkpoint: Path | None = None
    objects: str = "procedural"
    noise: Noise = "gaussian"
    fit_table: bool = False
    select: Selection = "best"
    robot: Robot = "hand"
    record: Recorded = "failures"
    shard: str | None = None
    workers: int = len(os.sched_getaffinity(0))
    scheduler: str = LOCAL
    limit_s: float = 3600.0
    out: Path | None = None

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if not self.limit_s > 0.0:
            raise ValueError(f"--limit-s is {self.limit_s}; expected seconds > 0")
        for name, least in (("rounds", 1), ("seeds", 1), ("first_seed", 0), ("workers", 1)):
            if getattr(self, name) < least:
                flag = name.replace("_", "-")
                raise ValueError(f"--{flag} is {getattr(self, name)}; expected {least} or more")
        if self.shard is not None:
            Shard.parse(self.shard)
        clutter_detector(self.detector, self.checkpoint)


def require_working_detector(options: ClutterOptions) -> None:
    """Raise BadInputError where no round could detect: no driver, or a wrong checkpoint."""
    check_rendering()
    clutter_detector(options.detector, options.checkpoint).check(options.checkpoint)


def layout_of(options: ClutterOptions) -> Layout:
    """Return the layout, its workspace the one that the detector was trained on."""
    detector = clutter_detector(options.detector, options.checkpoint)
    layout = Layout(workspace=detector.workspace(options.checkpoint))
    return arm_layout(layout) if options.robot == "arm" else layout


def run_config(options: ClutterOptions) -> dict[str, Any]:
    """Return the content of config.json."""
    config = {**asdict(options), **code_version()}
    config["objects_sha256"] = object_source(options.objects, Path("unused")).sha256()
    config["physics"] = round_station(Layout()).physics()
    if options.checkpoint is not None:
        config["checkpoint_sha256"] = file_sha256(options.checkpoint)
    return config


def missing_rounds(
    options: ClutterOptions, folder: Path, done: Collection[tuple[int, int]]
) -> list[RoundSpec]:
    """Return the rounds of a run, without those whose (seed, index) are `done`."""
    layout = layout_of(options)
    part = None if options.shard is None else Shard.parse(options.shard)
    objects = object_source(options.objects, folder / "decompositions")
    names = tuple(objects.names())
    return [
        RoundSpec(
            seed=options.first_seed + seed,
            index=index,
            scene=options.scene,
            objects=objects,
            names=names,
            detector=options.detector,
            checkpoint=options.checkpoint,
            noise=options.noise,
            fit_table=options.fit_table,
            select=options.select,
            layout=layout,
            robot=options.robot,
            record=options.record,
            folder=folder,
        )
        for seed in range(options.seeds)
        for index in range(options.rounds)
        if (options.first_seed + seed, index) not in done
        and (part is None or part.takes(seed * options.rounds + index))
    ]


def asked_records(options: ClutterOptions, records: Sequence[RoundRecord]) -> list[RoundRecord]:
    """Return the records that the options ask for, in the order of seeds and numbers."""
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    asked = [each for each in records if each.seed in seeds and each.index < options.rounds]
    return sorted(asked, key=lambda each: (each.seed, each.index))


def describe(records: Sequence[RoundRecord]) -> str:
    """Return the grasps that succeeded so far."""
    attempts = sum(len(record.grasps) for record in records)
    return f"{sum(record.successes for record in records)}/{attempts} grasps"


def main(options: ClutterOptions) -> Path:
    """Run what is missing of the rounds, report, and return the folder."""
    console = Console()
    require_scheduler(options.scheduler)
    folder = options.out or Path("runs/clutter_removal") / datetime.now().strftime("%Y%m%d-%H%M%S")
    try:
        config = run_config(options)
        object_source(options.objects, folder / "decompositions").names()
    except ObjectFileError as error:
        raise SystemExit(f"--objects: {error}") from error
    run = clutter_run(folder)
    require_working_detector(options)
    with run.claim(config, _FREE_KEYS, again=lambda record: record.failed_to_run):
        done = {(each.seed, each.index) for each in run.records()}
        specs = missing_rounds(options, folder, done)
        pool = make_pool(
            options.scheduler,
            options.workers,
            run_round,
            crashed_round,
            limit_s=options.limit_s,
            run=folder,
            kept=_KEPT,
        )
        run.collect(pool.run(specs), len(specs), console, describe)
        records = asked_records(options, run.records())
        if not records:
            raise SystemExit("no round was run")
        write_report(folder, records, config)
    print_removal(console, run_title(config), Removal.of(records))
    console.print(f"results: {folder}")
    errors = [record.detail or record.ended for record in records if record.failed_to_run]
    require_results(errors, len(records), folder)
    return folder


if __name__ == "__main__":
    run_command(main, ClutterOptions, __doc__)
