"""Mugs by name: building shapes from parameters, and the fixed splits.

``python -m split_drake.objects.mugs.split`` writes ``models/mugs/{train,test,thin}.json``, the
parameter sets that ``load_mug("train_017")`` builds a mug from.  Those of "thin" are for tests
alone: their grips, walls and handles leave the ranges that the others are drawn from.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from rich import print

from split_drake.bad_input import require_count, require_numbers
from split_drake.experiments.command import run_command
from split_drake.files import write_json
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.mugs.build import build_mug
from split_drake.objects.mugs.parameters import (
    RANGES,
    THIN_RANGES,
    MugParameters,
    sample_parameters,
)

Split = Literal["train", "test", "thin"]


def _split_text(split: str) -> str:
    if split not in get_args(Split):
        raise ValueError(f"split is {split!r}; expected one of {get_args(Split)}")
    return (MODELS_FOLDER / "mugs" / f"{split}.json").read_text()


@lru_cache(maxsize=3)
def _read_split(split: str) -> tuple[MugParameters, ...]:
    return tuple(MugParameters(**entry) for entry in json.loads(_split_text(split))["mugs"])


def mugs_sha256(split: Split) -> str:
    """Return the SHA-256 of the split's parameters: what is derived from the mugs records it."""
    return hashlib.sha256(_split_text(split).encode()).hexdigest()


def mug_names(split: Split) -> tuple[str, ...]:
    """Return the names of the split's mugs, such as "train_017"."""
    return tuple(f"{split}_{i:03d}" for i in range(len(_read_split(split))))


@lru_cache(maxsize=1)
def _places() -> dict[str, tuple[Split, int]]:
    """Return {name of a mug: its split and its number there}."""
    return {
        name: (split, number)
        for split in get_args(Split)
        for number, name in enumerate(mug_names(split))
    }


def _place(name: str) -> tuple[Split, int]:
    if name not in _places():
        raise ValueError(f"no mug is called {name!r}; expected train_000 or test_000 and so on")
    return _places()[name]


def mug_parameters(name: str) -> MugParameters:
    """Return the parameters of the mug `name`; raise ValueError where there is none."""
    split, number = _place(name)
    return _read_split(split)[number]


def load_mug(name: str) -> MugShape:
    """Return the mug `name` of the fixed split; raise ValueError where there is none."""
    split, number = _place(name)
    return build_mug(name, _read_split(split)[number], split, number)


def draw_mugs(
    count: int,
    rng: np.random.Generator,
    ranges: Mapping[str, tuple[float, float]] = RANGES,
) -> tuple[tuple[MugParameters, ...], Counter[str]]:
    """Return `count` valid parameter sets, and how many draws were rejected for which reason."""
    drawn: list[MugParameters] = []
    rejected: Counter[str] = Counter()
    while len(drawn) < count:
        parameters = sample_parameters(rng, ranges)
        try:
            build_mug("draft", parameters)
        except InvalidMugError as error:
            rejected[str(error).split(":")[0]] += 1
        else:
            drawn.append(parameters)
    return tuple(drawn), rejected


def _entry(parameters: MugParameters) -> dict[str, Any]:
    """Return what a file says of a mug.

    What was made of mugs records their file's hash, and older files know of no lift.
    """
    entry = asdict(parameters)
    if not parameters.handle_lift_m:
        del entry["handle_lift_m"]
    return entry


@dataclass(frozen=True)
class SplitConfig:
    """Draws the mugs that the project trains and tests on.

    Attributes:
        out: folder to write train.json, test.json and thin.json to.
        train: shapes for training.
        test: shapes for testing.
        thin: shapes for testing, with grips of 2 to 3 mm and walls of 1.5 to 13 mm.
        seed: of the draws; train and test come from one stream, so they differ in all parameters.
    """

    out: Path = Path("models/mugs")
    train: int = 200
    test: int = 40
    thin: int = 40
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self)
        require_count("train", self.train, 1)
        require_count("test", self.test, 1)
        require_count("thin", self.thin, 1)


def write_split(config: SplitConfig) -> None:
    """Draw the split, write it, and print the share of draws that were rejected."""
    mugs, rejected = draw_mugs(config.train + config.test, np.random.default_rng(config.seed))
    config.out.mkdir(parents=True, exist_ok=True)
    thin, too_thin = draw_mugs(config.thin, np.random.default_rng([config.seed, 1]), THIN_RANGES)
    rejected += too_thin
    splits = {"train": mugs[: config.train], "test": mugs[config.train :], "thin": thin}
    for split, chosen in splits.items():
        content = {"seed": config.seed, "mugs": [_entry(parameters) for parameters in chosen]}
        write_json(config.out / f"{split}.json", content)
    count = sum(map(len, splits.values()))
    draws = count + rejected.total()
    print(f"{count} mugs from {draws} draws, {rejected.total() / draws:.0%} rejected:")
    for reason, count in rejected.most_common():
        print(f"  {count / draws:6.1%}  {reason}")


if __name__ == "__main__":
    run_command(write_split, SplitConfig)
