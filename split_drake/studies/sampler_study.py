"""How accuracy follows the sampler: ``python -m split_drake.studies.sampler_study --out DIR``.

Every integrator with every number of evaluations of the score, and the shipped one at several
temperatures, meet the same scenes.  They are of mugs that checkpoints are trained on: what is
chosen here is measured on the test mugs, which therefore have no say in it.

DIR gets a folder each (see `evaluation`), study.json and study.png.  A study that was killed goes
on.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from split_drake.evaluation.evaluate import MugEvalOptions
from split_drake.evaluation.evaluation import evaluate
from split_drake.experiments.command import run_command
from split_drake.experiments.lock import locked
from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import RunPage
from split_drake.experiments.pages.study_page import made_with, picture, study_page
from split_drake.experiments.provenance import file_sha256
from split_drake.files import write_atomically, write_json
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.detector import SIXTEEN_EVALUATIONS, SamplerConfig, SplitDetector
from split_drake.split.sampling import (
    Integrator,
    LangevinConfig,
    annealed_langevin,
    heun,
    multistep,
    predictor_corrector,
)
from split_drake.station.layout import Layout

# What is told of a sampler, see `measure`.
Row = dict[str, Any]

EVALUATIONS = (100, 50, 25, 16, 12, 10, 8, 5)
# Of Langevin dynamics between the noise levels that ship, which need few.
FEW_EVALUATIONS = (16, 8, 6, 5, 4, 3, 2)
TEMPERATURES = (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)
LONG = SIXTEEN_EVALUATIONS.langevin
SHIPPED = LangevinConfig()
# Marked on the plots' logarithmic axes.
SHOWN_EVALUATIONS = (2, 4, 8, 16, 50, 100)
SHOWN_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True)
class Sampler:
    """What is compared.

    Attributes:
        integrator: one of `INTEGRATORS`.
        evaluations: of the score.
        temperature: of the noise it injects, if it injects any.
    """

    integrator: str
    evaluations: int
    temperature: float = LONG.temperature

    @property
    def name(self) -> str:
        """A name for its folder."""
        warmth = "" if self.temperature == LONG.temperature else f"_T{self.temperature:g}"
        return f"{self.integrator}_{self.evaluations:03d}{warmth}"

    def build(self) -> Integrator:
        """Return the integrator."""
        return INTEGRATORS[self.integrator](self)


def _langevin(sampler: Sampler) -> Integrator:
    steps = sampler.evaluations - LONG.final_steps
    config = replace(LONG, steps=steps, temperature=sampler.temperature)
    return partial(annealed_langevin, config=config)


def _short(sampler: Sampler) -> Integrator:
    steps = sampler.evaluations - SHIPPED.final_steps
    config = replace(SHIPPED, steps=steps, temperature=sampler.temperature)
    return partial(annealed_langevin, config=config)


def _heun(sampler: Sampler) -> Integrator:
    return partial(heun, steps=(sampler.evaluations + 1) // 2)


def _multistep(sampler: Sampler) -> Integrator:
    return partial(multistep, steps=sampler.evaluations)


def _predictor_corrector(sampler: Sampler) -> Integrator:
    steps = (sampler.evaluations + 1) // 2
    return partial(predictor_corrector, steps=steps, temperature=sampler.temperature)


SHORT = "short_langevin"
INTEGRATORS: Mapping[str, Callable[[Sampler], Integrator]] = {
    "langevin": _langevin,
    SHORT: _short,
    "heun": _heun,
    "multistep": _multistep,
    "predictor_corrector": _predictor_corrector,
}
# These evaluate the score twice a step, but for the last one: an odd number in all.
TWICE_A_STEP = ("heun", "predictor_corrector")
# Each measure, and the tasks that have it.
MEASURES: Mapping[str, Sequence[PoseTask]] = {
    "top_good": MUG_TASKS,
    "samples_good": MUG_TASKS,
    "accepted_good": MUG_TASKS,
    "coverage": (GRASP,),
}


@dataclass(frozen=True, kw_only=True)
class StudyConfig(MugEvalOptions):
    """A study of samplers.

    Attributes:
        out: folder to write to.
        checkpoint: weights; those of the project by default.
        workers: processes, of one thread each.
    """

    out: Path
    mugs: str = "train"
    scenes: int = 100
    checkpoint: Path | None = None
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mugs != "train":
            raise ValueError(
                f"mugs is {self.mugs!r}; expected 'train', since what is chosen here must be "
                "measured on other mugs than it was chosen on"
            )


def samplers() -> list[Sampler]:
    """Return the samplers that are compared."""
    by_evaluations = [
        Sampler(name, count - 1 if name in TWICE_A_STEP and count % 2 == 0 else count)
        for name in INTEGRATORS
        if name != SHORT
        for count in EVALUATIONS
    ]
    few = [Sampler(SHORT, count, SHIPPED.temperature) for count in FEW_EVALUATIONS]
    long = Sampler("langevin", LONG.evaluations)
    by_temperature = [replace(long, temperature=value) for value in TEMPERATURES]
    return list(dict.fromkeys([*by_evaluations, *few, *by_temperature]))


def make_detector(checkpoint: Path, sampler: Sampler) -> SplitDetector:
    """Return a detector that samples by `sampler`, and accepts what ships with such a sampler."""
    network, info = load_checkpoint(checkpoint)
    config = SamplerConfig() if sampler.integrator == SHORT else SIXTEEN_EVALUATIONS
    return SplitDetector(network, info.workspace, config, integrator=sampler.build())


def measure(config: StudyConfig, sampler: Sampler, console: Console) -> Row:
    """Return a sampler's row: its shares by measure and task, and the seconds of a detection."""
    checkpoint = config.checkpoint or default_weights()
    _, info = load_checkpoint(checkpoint)
    evaluation = config.evaluation(
        partial(make_detector, checkpoint, sampler),
        {**asdict(sampler), "checkpoint_sha256": file_sha256(checkpoint)},
        MUG_TASKS,
        Layout(workspace=info.workspace),
    )
    metrics = evaluate(evaluation, config.out / sampler.name, config.workers, console)
    shares = {
        name: {task.name: metrics["tasks"][task.name][name]["all"]["share"] for task in tasks}
        for name, tasks in MEASURES.items()
    }
    return {**asdict(sampler), "detect_s": metrics["median_detect_s"], **shares}


def study_table(rows: Sequence[Row]) -> Table:
    """Return a row a sampler, a column a measure and task."""
    columns = [(name, str(task)) for name, tasks in MEASURES.items() for task in tasks]
    titles = [f"{task}\n{name.replace('_', ' ')}" for name, task in columns]
    table = Table("integrator", "evaluations", "temperature", "seconds", *titles)
    for row in rows:
        shares = [f"{row[name][task]:.1%}" for name, task in columns]
        sampler = (row["integrator"], str(row["evaluations"]), f"{row['temperature']:g}")
        table.add_row(*sampler, f"{row['detect_s']:.3f}", *shares)
    return table


def page_of(rows: Sequence[Row], config: StudyConfig) -> RunPage:
    """Return the study's page."""
    shown = [
        {
            "integrator": row["integrator"],
            "evaluations": row["evaluations"],
            "temperature": row["temperature"],
            "seconds": row["detect_s"],
            **{
                f"{task}: {name.replace('_', ' ')}, %": round(100.0 * row[name][str(task)], 1)
                for name, tasks in MEASURES.items()
                for task in tasks
            },
        }
        for row in rows
    ]
    facts = {"mugs": config.mugs, "scenes": config.scenes, "seed": config.seed, **made_with()}
    settings = ("integrator", "evaluations", "temperature")
    return study_page("samplers on mugs", shown, settings, facts, [picture("study.png")], rows)


def _plot_measure(axes: Axes, rows: Sequence[Row], name: str, task: str, against: str) -> None:
    """Draw one measure of a task, a line an integrator."""
    for integrator in dict.fromkeys(row["integrator"] for row in rows):
        points = [
            (row[against], row[name][task]) for row in rows if row["integrator"] == integrator
        ]
        axes.plot(*zip(*sorted(points), strict=True), ".-", label=integrator)
    axes.set(title=f"{task}: {name.replace('_', ' ')}")
    axes.grid(alpha=0.3)


def plot_study(rows: Sequence[Row], path: Path) -> None:
    """Write how the measures follow the evaluations, the time, and the temperature."""
    columns = [(name, str(task)) for name, tasks in MEASURES.items() for task in tasks]
    as_warm = [
        row
        for row in rows
        if row["temperature"] == (SHIPPED if row["integrator"] == SHORT else LONG).temperature
    ]
    as_long = [
        row
        for row in rows
        if (row["integrator"], row["evaluations"]) == ("langevin", LONG.evaluations)
    ]
    lines = (
        ("evaluations", "evaluations of the score", as_warm),
        ("detect_s", "seconds a detection", as_warm),
        ("temperature", "temperature", as_long),
    )
    figure = Figure(figsize=(3.2 * len(columns), 3.0 * len(lines)), layout="constrained")
    grid = figure.subplots(len(lines), len(columns), sharey="col")
    for axes_line, (against, title, shown) in zip(grid, lines, strict=True):
        for axes, (name, task) in zip(axes_line, columns, strict=True):
            _plot_measure(axes, shown, name, task, against)
            axes.set(xlabel=title, xscale="linear" if against == "temperature" else "log")
    for ticks, axes_line in zip((SHOWN_EVALUATIONS, SHOWN_S), grid, strict=False):
        for axes in axes_line:
            axes.minorticks_off()
            axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    grid[0, 0].legend()
    figure.savefig(path, dpi=120)


def main(config: StudyConfig) -> None:
    """Measure all samplers; the table so far is written after each of them."""
    console = Console(soft_wrap=True)
    rows = []
    with locked(config.out):
        for sampler in samplers():
            console.print(sampler.name)
            rows.append(measure(config, sampler, console))
            write_json(config.out / "study.json", rows)
        plot_study(rows, config.out / "study.png")
        write_atomically(config.out / "index.html", render(page_of(rows, config)))
    console.print(study_table(rows))


if __name__ == "__main__":
    run_command(main, StudyConfig)
