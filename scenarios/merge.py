"""Parts of a run made one: ``python -m scenarios.merge RUN RUN ... --out DIR``.

The parts are folders of `scenarios.mug_hang` or of `scenarios.clutter_removal` that were made with
`--shard 1/5` to `--shard 5/5`, on machines that need not know of each other.  Parts of another run,
the same part twice, and records that are of another part are refused.  The folder then holds what
one run would have left; pictures and recordings are copied.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from scenarios.clutter.records import RoundRecord, clutter_run
from scenarios.clutter.report import write_report as write_rounds
from scenarios.trials.records import TrialRecord, trial_run
from scenarios.trials.report.page import write_report as write_trials
from split_drake.bad_input import BadInputError
from split_drake.experiments.command import run_command
from split_drake.experiments.run import CONFIG, RunFolder, require_no_files
from split_drake.experiments.shards import require_own, require_parts
from split_drake.files import read_json_object

# Folders of files that records name, beside the log.
_FILES = ("recordings", "stills", "films", "poses")
_WHAT = "the options of a run"


@dataclass(frozen=True)
class MergeOptions:
    """Which parts.

    Attributes:
        runs: folders of the parts, all of them.
        out: folder of the whole; new or empty.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path

    def __post_init__(self) -> None:
        if not self.runs:
            raise BadInputError("no runs were given; expected the folders of all parts")


def merge(options: MergeOptions, console: Console) -> None:
    """Write the whole of the parts.

    Raises BadInputError, or AnotherRunError, where they are no parts of one run, or some are
    missing.
    """
    for folder in options.runs:
        if not (folder / CONFIG).is_file():
            raise BadInputError(f"{folder} has no {CONFIG}; expected the folder of a run")
    configs = {folder: read_json_object(folder / CONFIG, _WHAT) for folder in options.runs}
    if missing := require_parts(configs):
        raise BadInputError(f"parts are missing: {', '.join(missing)}; expected all of them")
    require_no_files(options.out)
    config = {**next(iter(configs.values())), "shard": None, "out": str(options.out)}
    if trial_run(options.runs[0]).log.is_file():
        trials = _all_trials(configs)
        _write(trial_run(options.out), trials, config)
        wall_s = sum(sum(record.seconds.values()) for record in trials)
        write_trials(options.out, trials, config, wall_s)
        count = len(trials)
    else:
        rounds = _all_rounds(configs)
        _write(clutter_run(options.out), rounds, config)
        write_rounds(options.out, rounds, config)
        count = len(rounds)
    for folder in options.runs:
        _copy_files(folder, options.out)
    console.print(f"{count} records of {len(options.runs)} parts: {options.out}", markup=False)


def _all_trials(configs: Mapping[Path, Mapping[str, Any]]) -> list[TrialRecord]:
    found: list[TrialRecord] = []
    for folder, config in configs.items():
        records = trial_run(folder).records()
        require_own(config["shard"], [record.index for record in records], folder)
        found += records
    return sorted(found, key=lambda record: record.index)


def _all_rounds(configs: Mapping[Path, Mapping[str, Any]]) -> list[RoundRecord]:
    found: list[RoundRecord] = []
    for folder, config in configs.items():
        records = clutter_run(folder).records()
        first, rounds = int(config["first_seed"]), int(config["rounds"])
        numbers = [(each.seed - first) * rounds + each.index for each in records]
        require_own(config["shard"], numbers, folder)
        found += records
    return sorted(found, key=lambda record: (record.seed, record.index))


def _write(
    run: RunFolder[Any], records: Sequence[TrialRecord | RoundRecord], config: Mapping[str, Any]
) -> None:
    with run.claim(config):
        for record in records:
            run.append(record)


def _copy_files(folder: Path, out: Path) -> None:
    """Copy what records name; parts have no names in common but that of the shared script."""
    for name in _FILES:
        if (folder / name).is_dir():
            shutil.copytree(folder / name, out / name, dirs_exist_ok=True)


def main(options: MergeOptions) -> None:
    """Merge the parts."""
    merge(options, Console(soft_wrap=True))


if __name__ == "__main__":
    run_command(main, MergeOptions, __doc__)
