"""The table of the ablation: JSON, Markdown, and for the terminal."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.table import Table

from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import RunPage
from split_drake.experiments.pages.study_page import made_with, study_page
from split_drake.files import write_atomically, write_json
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask
from split_drake.split.checkpoint import load_checkpoint
from split_drake.studies.ablation_variants import Variant
from split_drake.training.training_folder import TrainingFolder

Figures = Mapping[str, Any]


@dataclass(frozen=True)
class Cost:
    """What the models of a variant cost, together.

    Attributes:
        parameters: that are trained.
        scene_steps: scenes seen in all training steps, those of earlier checkpoints included.
        minutes: of training; None where it was not recorded.
    """

    parameters: int
    scene_steps: int
    minutes: float | None

    @classmethod
    def of(cls, weights: tuple[Path, ...]) -> "Cost":
        """Return the cost of checkpoints, of which those in the folders of runs have curves."""
        loaded = [load_checkpoint(path) for path in weights]
        minutes = [_minutes(TrainingFolder(path.parent)) for path in weights]
        known = [value for value in minutes if value is not None]
        return cls(
            parameters=sum(p.numel() for network, _ in loaded for p in network.parameters()),
            scene_steps=sum(info.scenes_in_all for _, info in loaded),
            minutes=sum(known) if len(known) == len(minutes) else None,
        )


def _minutes(run: TrainingFolder) -> float | None:
    """Return how long a run trained, by its curves; None where there are none."""
    lines = run.read_curves() if run.curves.exists() else []
    return float(lines[-1]["minutes"]) if lines else None


@dataclass(frozen=True)
class Row:
    """A variant, what it cost and what it reaches.

    Attributes:
        metrics: those of `evaluation.evaluate`.
    """

    variant: Variant
    cost: Cost
    metrics: Figures

    def top(self, task: PoseTask, check: str = "top_good") -> str:
        """Return in which share of the scenes the top-ranked sample passes a check."""
        if check not in self.metrics["tasks"][task.name]:
            return "-"
        figures = self.metrics["tasks"][task.name][check]["all"]
        low, high = figures["wilson95"]
        return f"{figures['share']:.1%} [{100 * low:.1f}, {100 * high:.1f}]"

    def samples(self) -> str:
        """Return which shares of all samples are good, before any is rejected, by task."""
        of_tasks = [self.metrics["tasks"][task.name] for task in MUG_TASKS]
        shares = [figures["samples_good"]["all"]["share"] for figures in of_tasks]
        return " / ".join(f"{100 * share:.0f}" for share in shares)

    def record(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        kept = {key: value for key, value in self.metrics.items() if key != "by_subject"}
        return {
            "name": self.variant.name,
            "change": self.variant.change,
            "noise_m": self.variant.noise_m,
            "models": len(self.variant.models) or 1,
            "parameters": self.cost.parameters,
            "scene_steps": self.cost.scene_steps,
            "minutes": self.cost.minutes,
            "metrics": kept,
        }


COLUMNS: tuple[tuple[str, Callable[[Row], str]], ...] = (
    ("variant", lambda row: row.variant.name),
    ("what differs", lambda row: row.variant.change),
    ("noise, mm", lambda row: f"{1000 * row.variant.noise_m:.0f}"),
    *((str(task), partial(Row.top, task=task)) for task in MUG_TASKS),
    ("grasp holds", lambda row: row.top(GRASP, "top_holds")),
    ("all samples, %", Row.samples),
    ("scene-steps", lambda row: f"{row.cost.scene_steps:,}"),
    ("params, M", lambda row: f"{row.cost.parameters / 1e6:.2f}"),
    ("min", lambda row: "-" if row.cost.minutes is None else f"{row.cost.minutes:.0f}"),
)


def cells(rows: list[Row]) -> list[list[str]]:
    """Return the table's lines as texts, the heading first; columns of dashes are left out."""
    columns = [[title, *(show(row) for row in rows)] for title, show in COLUMNS]
    shown = [column for column in columns if set(column[1:]) != {"-"}]
    return [list(line) for line in zip(*shown, strict=True)]


def markdown(rows: list[Row]) -> str:
    """Return the table in Markdown."""
    heading, *lines = cells(rows)
    rule = ["---"] * len(heading)
    return "".join(f"| {' | '.join(line)} |\n" for line in (heading, rule, *lines))


def terminal_table(rows: list[Row]) -> Table:
    """Return the table for a terminal, which has no room to say what differs."""
    heading, *lines = (line[:1] + line[2:] for line in cells(rows))
    table = Table(title="good samples by task: share of the top-ranked [95% interval], and of all")
    for title in heading:
        table.add_column(title, overflow="fold")
    for line in lines:
        table.add_row(*line)
    return table


def page_of(rows: list[Row]) -> RunPage:
    """Return the ablation's page."""
    heading, *lines = cells(rows)
    return study_page(
        "ablation: good samples by task, top-ranked [95% interval], and of all",
        [dict(zip(heading, line, strict=True)) for line in lines],
        settings=("noise, mm",),
        facts=made_with(),
        records=[row.record() for row in rows],
    )


def write_report(rows: list[Row], out: Path) -> None:
    """Write ablations.json, ablations.md and index.html to the folder `out`."""
    document = {"rows": [row.record() for row in rows]}
    write_json(out / "ablations.json", document)
    write_atomically(out / "ablations.md", markdown(rows))
    write_atomically(out / "index.html", render(page_of(rows)))
