"""What a run of clutter removal comes to: a table, summary.json and index.html."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from scenarios.clutter.page import page_of
from scenarios.clutter.records import Removal, RoundRecord
from split_drake.experiments.pages.render import render
from split_drake.files import write_atomically, write_json

# Of the options, those that summary.json repeats.
_ASKED = ("scene", "detector", "robot", "noise", "fit_table", "select", "seeds")


def run_title(config: Mapping[str, Any]) -> str:
    """Return a line that names a run."""
    return "{scene}, {robot}, {detector}, noise {noise}, objects {objects}".format(**config)


def facts(removal: Removal) -> dict[str, str]:
    """Return the figures of a run, by their names."""
    counts = f"{removal.rounds} rounds, {removal.objects} objects, {removal.attempts} grasps"
    found = {
        "tried": counts,
        "grasps that succeeded (GSR)": str(removal.gsr),
        "objects taken (DR)": str(removal.dr),
    }
    for head, kinds in (("rounds ended", removal.ended), ("grasps failed", removal.failures)):
        if kinds:
            found[head] = "; ".join(f"{count}: {name}" for name, count in kinds.items())
    return found


def print_removal(console: Console, title: str, removal: Removal) -> None:
    """Print what rounds came to."""
    table = Table(title=title, show_header=False)
    for name, figure in facts(removal).items():
        table.add_row(name, figure.replace("; ", "\n"))
    console.print(table)


def write_report(folder: Path, records: Sequence[RoundRecord], config: Mapping[str, Any]) -> None:
    """Write summary.json and index.html, atomically."""
    asked = {key: config[key] for key in _ASKED} | {"objects_from": config["objects"]}
    write_json(folder / "summary.json", asked | Removal.of(records).to_json())
    write_atomically(folder / "index.html", render(page_of(records, config, run_title(config))))
