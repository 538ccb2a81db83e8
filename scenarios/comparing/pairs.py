"""Runs of one kind, put beside each other scene by scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from scenarios.clutter.records import RoundRecord, clutter_run
from scenarios.trials.records import TrialRecord, trial_run
from split_drake.bad_input import BadInputError
from split_drake.experiments.run import CONFIG
from split_drake.files import read_json_object

Record = TypeVar("Record", TrialRecord, RoundRecord)
# Options that the scenes depend on, of each kind of run: with others a seed gives another scene.
TRIAL_SCENES = ("task", "mugs", "mesh_sha256", "station_sha256", "objects")
ROUND_SCENES = ("scene", "objects_sha256", "robot")
# What tells nothing of how runs differ.
_DULL = frozenset(
    {"out", "workers", "record", "limit_s", "trials", "rounds", "seeds", "code_sha256"}
)


@dataclass(frozen=True)
class Run(Generic[Record]):
    """A run that was read.

    Attributes:
        path: of its folder.
        config: what was run.
        records: of it, by what a scene is known by.
    """

    path: Path
    config: Mapping[str, Any]
    records: Mapping[Any, Record]


def has_trials(folder: Path) -> bool:
    """Return whether a folder holds a run of trials, or else one of clutter removal.

    Raises BadInputError where it holds neither.
    """
    if not (folder / CONFIG).is_file():
        raise BadInputError(f"{folder} has no {CONFIG}; expected the folder of a run")
    for log, trials in ((trial_run(folder).log, True), (clutter_run(folder).log, False)):
        if log.is_file():
            return trials
    raise BadInputError(
        f"{folder} holds neither trials.jsonl nor rounds.jsonl; expected a run of "
        "scenarios.mug_hang or scenarios.clutter_removal"
    )


def read_trials(folder: Path) -> Run[TrialRecord]:
    """Return a run of trials, by their seeds; those that an error ended are left out."""
    found = {each.seed: each for each in trial_run(folder).records() if not each.failed_to_run}
    return Run(folder, _config(folder), found)


def read_rounds(folder: Path) -> Run[RoundRecord]:
    """Return a run of clutter removal, by seed and number."""
    records = [each for each in clutter_run(folder).records() if not each.failed_to_run]
    return Run(folder, _config(folder), {(each.seed, each.index): each for each in records})


def _config(folder: Path) -> dict[str, Any]:
    return read_json_object(folder / CONFIG, "the options of a run")


def paired(
    first: Run[Record], second: Run[Record], scenes: Sequence[str]
) -> list[tuple[Record, Record]]:
    """Return what both runs have of the same scenes, in the scenes' order.

    Raises BadInputError where the runs differ in one of `scenes`, or share none.
    """
    for name in scenes:
        ours, theirs = first.config.get(name), second.config.get(name)
        if ours != theirs:
            raise BadInputError(
                f"{first.path} has {name} {ours!r}, {second.path} has {theirs!r}: their scenes are "
                "not the same"
            )
    both = sorted(first.records.keys() & second.records.keys())
    if not both:
        raise BadInputError(f"{first.path} and {second.path} have no scene in common")
    return [(first.records[key], second.records[key]) for key in both]


def differences(first: Run[Record], second: Run[Record]) -> dict[str, tuple[Any, Any]]:
    """Return {option: (first's, second's)} of what the runs were asked for differently."""
    names = sorted((first.config.keys() | second.config.keys()) - _DULL)
    return {
        name: (first.config.get(name), second.config.get(name))
        for name in names
        if first.config.get(name) != second.config.get(name)
    }
