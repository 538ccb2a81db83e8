"""Two runs side by side: ``python -m scenarios.compare RUN RUN --out FILE.html``.

Runs are folders of `scenarios.mug_hang`, or of `scenarios.clutter_removal`, on the same scenes.
The page shows both rates, whether they differ (McNemar's exact test of trials, a paired bootstrap
over rounds), and each scene's two outcomes: what became worse first, then what became better.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from scenarios.comparing.page import relative, rounds_page, trials_page
from scenarios.comparing.pairs import (
    ROUND_SCENES,
    TRIAL_SCENES,
    differences,
    has_trials,
    paired,
    read_rounds,
    read_trials,
)
from split_drake.bad_input import BadInputError
from split_drake.experiments.command import run_command
from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import RunPage
from split_drake.files import write_atomically


@dataclass(frozen=True)
class CompareOptions:
    """Which runs.

    Attributes:
        runs: two folders; the second is said to be better or worse than the first.
        out: the page.
    """

    runs: Annotated[tuple[Path, Path], tyro.conf.Positional]
    out: Path = Path("runs/compare.html")


def compared(options: CompareOptions) -> RunPage:
    """Return the page of two runs; BadInputError where they cannot be compared."""
    first, second = options.runs
    kinds = [has_trials(folder) for folder in options.runs]
    if kinds[0] != kinds[1]:
        raise BadInputError(
            f"{first} and {second} are of different kinds; expected two runs of mug_hang, or two "
            "of clutter_removal"
        )
    names = (str(first), str(second))
    places = (relative(first, options.out), relative(second, options.out))
    if kinds[0]:
        trials = read_trials(first), read_trials(second)
        return trials_page(paired(*trials, TRIAL_SCENES), names, differences(*trials), places)
    rounds = read_rounds(first), read_rounds(second)
    return rounds_page(paired(*rounds, ROUND_SCENES), names, differences(*rounds), places)


def main(options: CompareOptions) -> None:
    """Write the page, and print what it comes to."""
    page = compared(options)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(options.out, render(page))
    console = Console(soft_wrap=True)
    for bar in page.bars:
        console.print(f"{bar.name}: {bar.shown}", markup=False)
    for name, value in page.facts:
        console.print(f"{name}: {value}", markup=False)
    console.print(f"page: {options.out}", markup=False)


if __name__ == "__main__":
    run_command(main, CompareOptions, __doc__)
