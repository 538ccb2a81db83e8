"""How accuracy follows the sampler: ``python -m split_drake.training.sampler_study --out DIR``.

Every integrator, with every number of evaluations of the score, meets the same scenes.  They are of
mugs that checkpoints are trained on: what is chosen here is measured on the test mugs, which
therefore have no say in it.

DIR gets a folder each (see `evaluation`), study.json and study.png.  A study that was killed goes
on.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from split_drake.data.dataset import file_sha256
from split_drake.pose_set import PoseTask
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.detector import SplitDetector
from split_drake.split.diffusion import Integrator, LangevinConfig, annealed_langevin
from split_drake.split.integrators import heun, multistep, predictor_corrector
from split_drake.split.network import TASKS
from split_drake.training.eval_scenes import EvalOptions
from split_drake.training.evaluation import evaluate

# What is told of a sampler, see `measure`.
Row = dict[str, Any]

EVALUATIONS = (100, 50, 25, 16, 12, 10, 8, 5)


def _langevin(evaluations: int) -> Integrator:
    shipped = LangevinConfig()
    config = replace(shipped, steps=evaluations - shipped.final_steps)
    return partial(annealed_langevin, config=config)


def _heun(evaluations: int) -> Integrator:
    return partial(heun, steps=(evaluations + 1) // 2)


def _multistep(evaluations: int) -> Integrator:
    return partial(multistep, steps=evaluations)


def _predictor_corrector(evaluations: int) -> Integrator:
    temperature = LangevinConfig().temperature
    return partial(predictor_corrector, steps=(evaluations + 1) // 2, temperature=temperature)


INTEGRATORS: Mapping[str, Callable[[int], Integrator]] = {
    "langevin": _langevin,
    "heun": _heun,
    "multistep": _multistep,
    "predictor_corrector": _predictor_corrector,
}
# These evaluate the score twice a step, but for the last one: an odd number in all.
TWICE_A_STEP = ("heun", "predictor_corrector")
# Each measure, and the tasks that have it.
MEASURES: Mapping[str, Sequence[PoseTask]] = {
    "top_good": TASKS,
    "samples_good": TASKS,
    "coverage": (PoseTask.GRASP,),
}


@dataclass(frozen=True, kw_only=True)
class StudyConfig(EvalOptions):
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


def samplers() -> list[tuple[str, int]]:
    """Return the integrators that are compared, each with its numbers of evaluations."""
    return [
        (name, count - 1 if name in TWICE_A_STEP and count % 2 == 0 else count)
        for name in INTEGRATORS
        for count in EVALUATIONS
    ]


def make_detector(checkpoint: Path, integrator: str, evaluations: int) -> SplitDetector:
    """Return a detector that samples by one of `INTEGRATORS` in so many evaluations."""
    network, _ = load_checkpoint(checkpoint)
    return SplitDetector(network, integrator=INTEGRATORS[integrator](evaluations))


def measure(config: StudyConfig, integrator: str, evaluations: int, console: Console) -> Row:
    """Return a sampler's row: its shares by measure and task, and the seconds of a detection."""
    checkpoint = config.checkpoint or default_weights()
    sampler = {"integrator": integrator, "evaluations": evaluations}
    metrics = evaluate(
        partial(make_detector, checkpoint, integrator, evaluations),
        {**sampler, "checkpoint_sha256": file_sha256(checkpoint)},
        config,
        config.out / f"{integrator}_{evaluations:03d}",
        config.workers,
        console,
    )
    shares = {
        name: {str(task): metrics[str(task)][name]["all"]["share"] for task in tasks}
        for name, tasks in MEASURES.items()
    }
    return {**sampler, "detect_s": metrics["median_detect_s"], **shares}


def study_table(rows: Sequence[Row]) -> Table:
    """Return a row a sampler, a column a measure and task."""
    columns = [(name, str(task)) for name, tasks in MEASURES.items() for task in tasks]
    titles = [f"{task}\n{name.replace('_', ' ')}" for name, task in columns]
    table = Table("integrator", "evaluations", "seconds", *titles)
    for row in rows:
        shares = [f"{row[name][task]:.1%}" for name, task in columns]
        table.add_row(row["integrator"], str(row["evaluations"]), f"{row['detect_s']:.3f}", *shares)
    return table


def _plot_measure(axes: Axes, rows: Sequence[Row], name: str, task: str, against: str) -> None:
    """Draw one measure of a task, a line an integrator."""
    for integrator in INTEGRATORS:
        points = [
            (row[against], row[name][task]) for row in rows if row["integrator"] == integrator
        ]
        axes.plot(*zip(*sorted(points), strict=True), ".-", label=integrator)
    axes.set(xscale="log", title=f"{task}: {name}")
    axes.grid(alpha=0.3)


def plot_study(rows: Sequence[Row], path: Path) -> None:
    """Write how the measures follow the evaluations (above) and the time (below)."""
    columns = [(name, str(task)) for name, tasks in MEASURES.items() for task in tasks]
    figure = Figure(figsize=(3.2 * len(columns), 6.0), layout="constrained")
    titles = {"evaluations": "evaluations of the score", "detect_s": "seconds a detection"}
    grid = figure.subplots(len(titles), len(columns), sharey="col")
    for line, (against, title) in zip(grid, titles.items(), strict=True):
        for axes, (name, task) in zip(line, columns, strict=True):
            _plot_measure(axes, rows, name, task, against)
            axes.set(xlabel=title)
    for axes in grid[0]:
        axes.minorticks_off()
        axes.set_xticks(EVALUATIONS, [str(count) for count in EVALUATIONS])
    grid[0, 0].legend()
    figure.savefig(path, dpi=120)


def main(config: StudyConfig) -> None:
    """Measure all samplers; the table so far is written after each of them."""
    console = Console(soft_wrap=True)
    rows = []
    for integrator, evaluations in samplers():
        console.print(f"{integrator}, {evaluations} evaluations")
        rows.append(measure(config, integrator, evaluations, console))
        (config.out / "study.json").write_text(json.dumps(rows, indent=1) + "\n")
    plot_study(rows, config.out / "study.png")
    console.print(study_table(rows))


if __name__ == "__main__":
    main(tyro.cli(StudyConfig))
