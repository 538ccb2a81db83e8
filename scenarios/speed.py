"""How fast detections and trials are: `python -m scenarios.speed`.

Detections are timed in turns with VGN's planner, with one thread and with two.  Trials run with one
worker and with two, recordings included.  With `--against COMMIT` the same trials run by that
commit as well, in turns with these, one core each.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from scenarios import mug_hang
from scenarios.timing.commits import CommitComparison, checked_out, compare_commits
from scenarios.timing.detection_speed import VGN, DetectionSpeed, detection_speeds
from scenarios.timing.workers import Figure, figures
from scenarios.trials.detection import trial_detector
from scenarios.trials.records import TrialRecord, trial_run
from split_drake.bad_input import BadInputError, require_count, require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import code_version, processor
from split_drake.experiments.run import as_json, claim_folder
from split_drake.files import interpreting, read_json_object, write_json

THREADS = (1, 2)
# What may differ when runs go on: it changes no trial.
_FREE_KEYS = ("detections", "trials", "against", "out")


@dataclass(frozen=True)
class SpeedOptions:
    """What is timed.

    Attributes:
        out: folder for the runs; those that were interrupted go on.
        detections: how often each kind of detection is timed; 0 to leave them out.
        trials: in each run; 0 to leave them out.
        seed: of the first trial.
        detector: as in mug_hang; SPLIT alone where commits are compared.
        against: a commit whose trials are timed beside those of this code, in place of those by
            two workers.
    """

    out: Path
    detections: int = 11
    trials: int = 40
    seed: int = 0
    detector: str = "split"
    against: str | None = None

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        for name in ("detections", "trials", "seed"):
            require_count(f"--{name}", getattr(self, name))
        trial_detector(self.detector)
        if self.against is not None and not self.trials:
            raise BadInputError("--against compares trials, --trials is 0; expected 1 at least")
        if self.against is not None and self.detector != "split":
            raise BadInputError(
                f"--against compares trials of SPLIT, --detector is {self.detector!r}; leave it out"
            )


def timed_run(options: SpeedOptions, workers: int) -> tuple[list[TrialRecord], float]:
    """Return the records of a whole run, and the wall time it took, s.

    Raises BadInputError where the run was interrupted, its folder holds more trials than asked for,
    or trials of a run that was killed, whose time nobody knows.
    """
    folder = options.out / f"{workers}_workers"
    before = len(trial_run(folder).records())
    if before and _timed_trials(folder) != before:
        raise BadInputError(
            f"{folder} holds {before} trials, and the time of {_timed_trials(folder)}: the run was "
            "killed; choose another --out"
        )
    mug_hang.main(
        mug_hang.MugHangOptions(
            trials=options.trials,
            seed=options.seed,
            detector=options.detector,
            workers=workers,
            out=folder,
        )
    )
    # They arrive as they end: with two workers the second may be first.
    records = sorted(trial_run(folder).records(), key=lambda record: record.index)
    if len(records) < options.trials:
        raise BadInputError(
            f"{folder} holds {len(records)} of {options.trials} trials: the run was interrupted; "
            "the same command goes on from there"
        )
    if len(records) > options.trials:
        raise BadInputError(
            f"{folder} holds {len(records)} trials, --trials is {options.trials}; expected as many "
            "as it holds, or another --out"
        )
    return records, mug_hang.earlier_wall_s(folder)


def _timed_trials(folder: Path) -> int:
    """Return how many trials the run's wall time is that of."""
    path = folder / "summary.json"
    if not path.exists():
        return 0
    with interpreting(path, what := "the summary of a run"):
        return int(read_json_object(path, what)["trials"])


def detection_table(speeds: Sequence[DetectionSpeed]) -> Table:
    """Return what detections take, and how much of the time of VGN's planner that is."""
    heads = [f"{each.threads} thread{'s' * (each.threads > 1)}, ms" for each in speeds]
    table = Table("detection", *heads, "of VGN's", f"{speeds[-1].threads} threads faster by")
    for name in speeds[0].seconds:
        taken = [each.seconds[name] for each in speeds]
        shares = "" if name == VGN else ", ".join(f"{each.ratio(name):.2f}" for each in speeds)
        times = (f"{1e3 * each:.0f}" for each in taken)
        table.add_row(name, *times, shares, f"{taken[0] / taken[-1]:.2f}")
    return table


def trial_table(found: Sequence[Figure]) -> Table:
    """Return figures of trials beside what is promised."""
    table = Table("figure", "measured", "promised", "")
    for figure in found:
        bound = f"{'<=' if figure.at_most else '>='} {figure.bound:g}"
        table.add_row(figure.name, f"{figure.value:.2f}", bound, "" if figure.met else "missed")
    return table


def comparison_table(compared: CommitComparison, against: str) -> Table:
    """Return what planning and execution take by both commits, and how trials end."""
    low, high = compared.ratio_95
    table = Table("", "this code", against)
    means = (float(seconds.mean()) for seconds in compared.seconds())
    table.add_row("planning and execution, mean s", *(f"{mean:.2f}" for mean in means))
    table.add_row("of the other's time", f"{compared.ratio:.2f} [{low:.2f}, {high:.2f}]", "")
    table.add_row("of trials that both executed", str(len(compared.timed)), "")
    both = (compared.ours, compared.theirs)
    counts = (f"{sum(t.succeeded for t in trials.values())}/{len(trials)}" for trials in both)
    table.add_row("trials that succeed", *counts)
    table.add_row("McNemar's p", f"{compared.mcnemar_p:.2f}", "")
    return table


def main(options: SpeedOptions) -> None:
    """Time what is asked for and print it; speed.json in the folder holds the numbers."""
    console = Console()
    console.print(f"on {processor()}", markup=False, highlight=False)
    config = as_json(asdict(options)) | code_version()
    with claim_folder(options.out, config, _FREE_KEYS):
        if options.detections:
            speeds = detection_speeds(THREADS, options.detections)
            console.print(detection_table(speeds))
            _keep(options.out, "detections", {each.threads: dict(each.seconds) for each in speeds})
        if options.trials and options.against is None:
            alone, alone_wall_s = timed_run(options, workers=1)
            found = figures(alone, alone_wall_s, *timed_run(options, workers=2))
            console.print(trial_table(found))
            _keep(options.out, "trials", {each.name: each.value for each in found})
        if options.trials and options.against is not None:
            seeds = range(options.seed, options.seed + options.trials)
            with checked_out(options.against) as theirs:
                compared = compare_commits(theirs.tree, seeds, options.out / theirs.commit)
            console.print(comparison_table(compared, options.against))
            _keep(options.out, f"against {theirs.commit}", compared.figures())


def _keep(out: Path, name: str, found: object) -> None:
    """Put what was measured into speed.json, beside what is there."""
    path = out / "speed.json"
    there = read_json_object(path, "what was timed") if path.exists() else {}
    write_json(path, {**there, "processor": processor(), name: found})


if __name__ == "__main__":
    run_command(main, SpeedOptions, __doc__)
