"""Draw the curves of runs: ``python -m split_drake.training.curves RUN [RUN ...] --out FILE``.

Runs may still be going on.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, StrMethodFormatter

from split_drake.bad_input import BadInputError
from split_drake.experiments.command import run_command
from split_drake.poses import Array
from split_drake.training.training_folder import TrainingFolder

# Key in the curves, title of the panel, whether its axis is logarithmic; the tasks' come before.
PANELS = (
    ("focal", "focal loss of the evaluator", True),
    ("learning_rate", "learning rate", False),
    ("scenes_per_s", "scenes a second", False),
)
# What else a line of the curves has, that is no loss of a task.
_COUNTS = ("step", "scenes", "minutes")
_COLUMNS = 3


@dataclass(frozen=True)
class CurvesConfig:
    """What to draw.

    Attributes:
        runs: folders of training runs, a line each in every panel.
        out: image to write, by its suffix a PNG, PDF or SVG.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path = Path("curves.png")

    def __post_init__(self) -> None:
        if not self.runs:
            raise ValueError("no runs were given; expected the folder of at least one")


def read_curves(folder: Path) -> dict[str, Array]:
    """Return the curves of the run in `folder`, each (N,), by their keys.

    "scenes_per_s" is that since the line before.  Raises ValueError where the folder has no curves.
    """
    lines = TrainingFolder(folder).read_curves()
    if not lines:
        raise BadInputError(f"{folder} has no curves; expected the folder of a training run")
    curves = {key: np.array([line[key] for line in lines], dtype=float) for key in lines[0]}
    seconds = 60.0 * np.diff(curves["minutes"], prepend=0.0)
    curves["scenes_per_s"] = np.diff(curves["scenes"], prepend=0.0) / np.maximum(seconds, 1e-9)
    return curves


def draw_curves(runs: dict[str, dict[str, Array]]) -> Figure:
    """Return a figure of the curves of several runs, by their names; tasks may be missing."""
    others = {*_COUNTS, *(key for key, _, _ in PANELS)}
    tasks = dict.fromkeys(key for curves in runs.values() for key in curves if key not in others)
    shown = [*((task, f"denoising loss, {task}", True) for task in tasks), *PANELS]
    rows = -(-len(shown) // _COLUMNS)
    figure = Figure(figsize=(4.0 * _COLUMNS, 3.25 * rows), layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False)
    for axes in panels.flat[len(shown) :]:
        axes.set_visible(False)
    for axes, (key, title, logarithmic) in zip(panels.flat, shown, strict=False):
        for number, (name, curves) in enumerate(runs.items()):
            if key in curves:
                style = {"color": f"C{number}", "linewidth": 1.0}
                axes.plot(curves["scenes"], curves[key], label=name, **style)
        axes.set_title(title, fontsize="medium")
        if logarithmic:
            axes.set_yscale("log")
            for set_formatter in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
                set_formatter(StrMethodFormatter("{x:.3g}"))
        axes.grid(alpha=0.3)
    for axes in panels.flat[: len(shown)][-_COLUMNS:]:
        axes.set_xlabel("scenes seen")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.xaxis.set_tick_params(labelbottom=True)
    panels.flat[len(shown) - 1].legend(fontsize="small")
    return figure


def main(config: CurvesConfig) -> None:
    """Read the runs and write the image."""
    figure = draw_curves({str(folder): read_curves(folder) for folder in config.runs})
    config.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(config.out, dpi=120)


if __name__ == "__main__":
    run_command(main, CurvesConfig, __doc__)
